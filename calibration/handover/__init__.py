"""Hand-over to particle codes: the cheapest law that keeps a tolerance, written for a code.

wanted       the law and velocities asked for
substitutes  cheaper laws in its place
impacts      what happens at these velocities, without steps
steps        impacts stepped as codes step them: what a time step costs
choice       the first law that keeps the tolerance
softer       softer springs at the same ε, and k2 that grows
c_header     a law as C source;  c_table: one's own law as a table of forces
c, lammps, liggghts, yade    the files of each code
exported     what was handed over, as it is told;  picture: drawn
door         `export`
"""
