"""The subcommands of `softjax`, one file each.

To add one: put its name and what it does into `COMMANDS`, and write `commands/<name>.py` with

    def add_arguments(parser: argparse.ArgumentParser) -> None: ...
    def run(arguments: argparse.Namespace) -> int: ...         # the exit code, 0 or 1

The file is imported when its command is run; heavy imports belong inside `run`. `arguments` has the
common `out` (a Path) and `quiet` and the command's own. Input that cannot be used is
refused by raising an `InputError` or a `DataError` before anything is written: exit code 2. Any other
error prints its trace: exit code 70.
"""

COMMANDS = {
    "curve": "restitution over velocity: numbers, look-up table, picture",
    "sensitivity": "sensitivities, information of planned measurements, where to measure next",
    "fit": "fit χ̃, σ, ψ to measured rebounds (without a file: the paper's three materials)",
    "compare": "fit every contact law and rank the laws by how well they predict",
    "export": "write a law for LAMMPS, LIGGGHTS, YADE or C, with its error",
    "speed": "measure speed against error on this machine",
    "doctor": "versions, devices and a self-check, for reports of faults",
}
