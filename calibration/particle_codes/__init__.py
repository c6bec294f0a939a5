"""Export of contact laws to particle codes: the cheapest law that keeps a tolerance, written for a code.

target       the law and its ε over the range of velocities
surrogates   cheaper laws in its place; the same ε by softer springs
steps        impacts stepped as codes step them: what a time step costs
choice       the first law that keeps the tolerance
c_header     a law as C source;  c_table: a user's law as a table of forces
lammps, liggghts, yade    the files of each code
report       the result of an export, printed, drawn and as export.json
entry        `export`
"""
