"""What the tests of exports share: steel spheres, laws to hand over, headers compiled for ctypes."""

import ctypes
import math
import os
import shutil
import subprocess
import tempfile
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import softjax as sj
from tests.cases import fitted, pair

HARNESS = Path(__file__).parent / "harness.c"
WARNINGS = ["-Wall", "-Wextra", "-pedantic", "-Wconversion", "-Wshadow", "-Werror"]
COMPILERS = {"c": ["gcc", "-std=c99"], "c++": ["g++", "-std=c++11"]}

needs_compiler = pytest.mark.skipif(
    "SOFTJAX_TEST_EXTRAS" not in os.environ and shutil.which("gcc") is None, reason="no C compiler"
)

PAIR = pair("stainless steel")
STEEL = fitted("stainless steel")
MASS, DENSITY = float(PAIR.mass), 8030.0
RANGE = (0.1, 5.0)  # m/s
SPRING = float(PAIR.stiffness) * math.sqrt(float(PAIR.radius))  # N/m, as stiff as Hertz at δ = R
VELOCITIES = (0.1, 1.0, 5.0)
INDEPENDENT = {
    "zhou": STEEL,
    "zhou full": fitted("stainless steel", "full"),
    "thornton": sj.Thornton(pair("stainless steel", "hertz"), 2.8),
    "walton-braun": sj.WaltonBraun(PAIR, SPRING, 1.2 * SPRING, 100.0),
}
DAMPED = {
    "linear": sj.LinearSpringDashpot(PAIR, 1e7, 0.8),
    "linear, no pull": sj.LinearSpringDashpot(PAIR, 1e7, 0.8, end="zero-force"),
    "hertz": sj.HertzDashpot(PAIR, 0.8),
    "hertz, no pull": sj.HertzDashpot(PAIR, 0.8, end="zero-force"),
    "viscoelastic": sj.ViscoelasticHertz(PAIR, 2e-6),
}
LAWS = INDEPENDENT | DAMPED


class Compiled:
    """A header behind the harness; SI throughout."""

    def __init__(self, source: str, flags: tuple[str, ...] = ()):
        folder = Path(tempfile.mkdtemp())
        header, library = folder / "law.h", folder / "law.so"
        header.write_text(source, encoding="utf-8")
        options = [f'-DSOFTJAX_HEADER="{header}"', *flags, "-O2", "-shared", "-fPIC"]
        files = ["-x", "c", HARNESS, "-o", library, "-lm"]
        subprocess.run([*COMPILERS["c"], *options, *files], check=True)
        self.library = ctypes.CDLL(str(library))
        self.library.gained.restype = ctypes.c_double
        shutil.rmtree(folder)

    def rebounds(self, velocity, step, phase: float = 0.3, contact=PAIR, gravity=0.0) -> np.ndarray:
        """ε of impacts with time steps [s]; a fraction of a step passes before touch."""
        return self.impacts(velocity, step, phase, contact, gravity)[0]

    def impacts(self, velocity, step, phase: float = 0.3, contact=PAIR, gravity=0.0) -> np.ndarray:
        """ε, how long there is a force [s], largest overlap [m] and largest force [N], one a row."""
        velocity = np.ascontiguousarray(velocity, float)
        step = np.ascontiguousarray(np.broadcast_to(step, velocity.shape), float)
        numbers = np.empty((4, len(velocity)))
        arrays = map(_pointer, (velocity, step))
        out = (ctypes.c_double(phase), ctypes.c_double(gravity), _pointer(numbers))
        self.library.restitution(len(velocity), *_sizes(contact), *arrays, *out)
        return numbers

    def forces(self, overlap, rate=0.0, contact=PAIR) -> tuple[np.ndarray, np.ndarray]:
        """Force [N] and stiffness [N/m] of one contact that goes through these overlaps."""
        overlap = np.ascontiguousarray(overlap, float)
        rate = np.ascontiguousarray(np.broadcast_to(rate, overlap.shape), float)
        outputs = np.empty_like(overlap), np.empty_like(overlap)
        arrays = map(_pointer, (overlap, rate, *outputs))
        self.library.forces(len(overlap), *_sizes(contact), *arrays)
        return outputs

    def gained(self, turns, samples: int = 2000, contact=PAIR) -> tuple[float, float]:
        """Energy won over a way between turning points [J], and the most that was in the contact."""
        turns, most = np.ascontiguousarray(turns, float), ctypes.c_double()
        arguments = (len(turns), _pointer(turns), samples, *_sizes(contact), ctypes.byref(most))
        return self.library.gained(*arguments), most.value

    def largest_error(
        self, velocity, expected, step, phases=(0.0, 0.3, 0.6, 0.9), contact=PAIR, gravity=0.0
    ) -> float:
        """Of ε over several beginnings of an impact within a step."""
        rebounds = [self.rebounds(velocity, step, phase, contact, gravity) for phase in phases]
        return float(np.max(np.abs(np.array(rebounds) - expected)))


@lru_cache
def compiled(source: str, flags: tuple[str, ...] = ()) -> Compiled:
    return Compiled(source, flags)


def compiler_says(text: str, language: str, folder: Path) -> str:
    """The compiler's messages about a program, with all warnings as errors."""
    file = folder / "program"
    file.write_text(text, encoding="utf-8")
    command = [*COMPILERS[language], *WARNINGS, "-fsyntax-only", "-x", language, str(file)]
    return subprocess.run(command, capture_output=True, text=True).stderr


def _sizes(contact):
    return ctypes.c_double(float(contact.radius)), ctypes.c_double(float(contact.mass))


def _pointer(array):
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
