"""Export of contact laws to particle codes: the cheapest law that keeps a tolerance, written for a code.

codes        what each particle code takes
target       the law and its ε over the range of velocities
surrogates   cheaper laws in its place; the same ε by softer springs
steps        impacts stepped as codes step them: what a time step costs
choice       the first law that keeps the tolerance;  c_table: a user's law as a table of forces
report       the result of an export, printed, drawn and as export.json
files        input lines of each code, and the C header
entry        `export`
"""
