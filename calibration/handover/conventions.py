"""What particle codes make of their input: the law that they follow, told by their own numbers.

"Restitution in, restitution out" fails by an end of the contact that is another, by a factor that
is missing, by a unit. Each function here takes what a code's input takes and gives the contact law
that the code then integrates; `calibration.handover.lammps` and its neighbours go the other way.
Measured: LAMMPS 22 July 2025, LIGGGHTS 3.8.0, YADE 2023.02a.
"""

import math
from dataclasses import replace

import numpy as np

import softjax as sj
from calibration.handover.damping import fraction_of, rebound, set_restitution
from calibration.handover.wanted import number_of
from softjax.laws.base import ReducedRateDependent
from softjax.laws.viscoelastic import ReducedViscoelastic

# a polynomial for α(ε) that LAMMPS takes for Tsuji's, in powers of ε
TSUJI = (1.2728, -4.2783, 11.087, -22.348, 27.467, -18.022, 4.8218)
COEFF_RESTITUTION = 20240627  # the first LAMMPS release with it
TSUJI_MENDED = 20260730  # LAMMPS' Tsuji damping has lacked a √2 in releases before that day


def end_with(clamped: bool) -> str:
    """Where a contact ends: with its force clamped at zero, or with its overlap."""
    return "zero-force" if clamped else "zero-overlap"


class PullingViscoelastic(sj.ViscoelasticHertz):
    """Viscoelastic spheres whose force may pull: LAMMPS without `limit_damping`."""

    def reduced(self) -> ReducedRateDependent:
        return _PullingViscoelastic(super().reduced().dissipation)


class _PullingViscoelastic(ReducedViscoelastic):
    ends_at: str = "zero-overlap"


def lammps_coeff_restitution(contact, restitution: float, limit_damping: bool) -> sj.HertzDashpot:
    """`hertz … e … damping coeff_restitution [limit_damping]`."""
    return sj.HertzDashpot(contact, restitution, end=end_with(limit_damping))


def lammps_tsuji(contact, restitution: float, limit_damping: bool, version: int) -> sj.HertzDashpot:
    """`hertz … e … damping tsuji`: α of a polynomial, over √2 in most releases."""
    alpha = tsuji_alpha(restitution) * (math.sqrt(2) if version >= TSUJI_MENDED else 1.0)
    fraction = min(max(alpha / math.sqrt(5), 0.0), 1 - 1e-12)
    return sj.HertzDashpot(contact, set_restitution(fraction), end=end_with(limit_damping))


def tsuji_alpha(restitution: float) -> float:
    return float(np.polynomial.polynomial.polyval(restitution, TSUJI))
