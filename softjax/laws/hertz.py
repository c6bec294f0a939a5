"""Hertz's elastic contact of two spheres."""

import math

from softjax.contact import Contact
from softjax.fields import Numbers
from softjax.laws.base import RateIndependentLaw
from softjax.laws.reduced import ReducedRateIndependent
from softjax.numerics.powers import power_3_2


class Hertz(RateIndependentLaw, final=True):
    """Two elastic spheres: what is stored on loading comes back, ε = 1.

        P = k δ^{3/2},  k = 4/3 E √R,    δ_max = (5 M v²/(4k))^{2/5},    T = 2.943… δ_max/v

    Symbols: P force [N]; δ overlap [m]; k, E, R, M: `contact.stiffness` [N/m^1.5],
    `.youngs_modulus` [Pa], `.radius` [m], `.mass` [kg]; v impact velocity [m/s]; T duration [s].

    Not to be confused with `HertzDashpot` and `ViscoelasticHertz`, which add a damping force to
    this elastic one.

    Attributes:
        contact: the two bodies; their yield strength and limit velocity do not enter.

    Source: Hertz, J. reine angew. Math. 92, 156 (1882).
    Range: smooth bodies, overlaps far below R, velocities far below the speed of sound in them
    and below that of first yield.
    """

    never_yields = True

    contact: Contact

    def reduced(self) -> "ReducedHertz":
        return ReducedHertz()


class ReducedHertz(ReducedRateIndependent):
    """p = x^{3/2} on loading and on unloading: it never leaves the elastic stage."""

    elastic_limit = math.inf

    def loading(self, x: Numbers) -> Numbers:
        return power_3_2(x)

    def unloading(self, x: Numbers, peak: Numbers) -> Numbers:
        return power_3_2(x)
