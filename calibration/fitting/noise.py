"""Families of noise: the density of one residual r of variance V, and all that sets one family apart.

A further family is a class with the methods of `Normal`, smooth at r = 0, an entry of `FAMILIES` and the
same word in `FitOptions.noise`. Its fields are numbers of its own, set by `FitOptions.noise_<field>`; the
places that have `noise_dof` by name are to have it, too.
All but `Normal` are for independent errors. Prediction bands and `far_from_stated` take quantiles of t with its
`dof`; `uncertainty` has errors of variances as of that many residuals.

Methods with `xp` work for NumPy and for jax.numpy; the others are for searches, in NumPy.
"""

import math
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np
from scipy import special

from calibration.options import FitOptions

LN_2PI = math.log(2 * math.pi)


@dataclass(frozen=True, eq=False)
class Normal:
    """-2 ln p = r²/V + ln V + ln 2π."""

    name: ClassVar[Any] = "normal"
    dof: ClassVar[Any] = math.inf  # degrees of freedom of t whose quantiles residuals have
    information: ClassVar[Any] = 1.0  # Fisher's, of one residual, times V
    words: ClassVar[Any] = "normal errors"

    def quantile(self, probability: Any) -> Any:
        """Of residuals r/√V."""
        return special.ndtri(probability)

    def farthest(self, count: int, probability: float) -> float:
        """Size that one of so many residuals exceeds with this probability."""
        return float(self.quantile(1 - 0.5 * probability / count))

    def log_density(self, off: Any, variance: Any, xp: Any = np) -> Any:
        """ln p of residuals."""
        return -0.5 * (off**2 / variance + xp.log(variance) + LN_2PI)

    def log_predictive(self, off: Any, variance: Any, degrees: Any) -> Any:
        """ln p where the variance is estimated with these degrees of freedom; for normal errors alone."""
        finite = np.where(np.isinf(degrees), 1.0, degrees)
        heavy = StudentT(finite).log_density(off, variance)
        return np.where(np.isinf(degrees), self.log_density(off, variance), heavy)

    def squares(self, white: Any) -> Any:
        """-2 ln of p over its largest value, of residuals r/√V."""
        return white**2

    def weight(self, white: Any) -> Any:
        """-∂ln p/∂r V/r: what multiplies r² in least squares of the same gradient."""
        return np.ones_like(white)

    def from_normal(self, normal: Any, xp: Any = np) -> Any:
        """Residuals r/√V as a smooth function of standard normal numbers, one each."""
        return normal

    def drawn(self, normal: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """Residuals from normal ones of variance V."""
        return normal


@dataclass(frozen=True, eq=False)
class StudentT(Normal):
    """-2 ln p = (ν + 1) ln(1 + r²/(ν V)) + ln V - 2 ln c_ν; √V is the scale.

    Source: Lange, Little and Taylor, J. Am. Stat. Assoc. 84, 881 (1989).

    Attributes:
        dof: ν.
    """

    name: ClassVar[Any] = "student-t"
    dof: Any  # type: ignore[misc]

    @property
    def information(self) -> Any:  # type: ignore[override]
        return (self.dof + 1) / (self.dof + 3)

    @property
    def words(self) -> str:  # type: ignore[override]
        return f"Student's t of {self.dof:.3g} degrees of freedom"

    def quantile(self, probability: Any) -> Any:
        return special.stdtrit(self.dof, probability)

    def log_density(self, off: Any, variance: Any, xp: Any = np) -> Any:
        if xp is np:
            from scipy.special import gammaln
        else:
            from jax.scipy.special import gammaln
        nu = self.dof
        level = gammaln(0.5 * (nu + 1)) - gammaln(0.5 * nu) - 0.5 * xp.log(math.pi * nu)
        return level - 0.5 * xp.log(variance) - 0.5 * (nu + 1) * xp.log1p(off**2 / (nu * variance))

    def log_predictive(self, off: Any, variance: Any, degrees: Any) -> Any:
        return self.log_density(off, variance)

    def squares(self, white: Any) -> Any:
        return (self.dof + 1) * np.log1p(white**2 / self.dof)

    def weight(self, white: Any) -> Any:
        return (self.dof + 1) / (self.dof + white**2)  # which tends to 1 as ν grows

    def from_normal(self, normal: Any, xp: Any = np) -> Any:
        """The same in good approximation. Source: Wallace, Ann. Math. Stat. 30, 1124 (1959)."""
        stretched = normal * (8 * self.dof + 3) / (8 * self.dof + 1)
        return xp.sign(normal) * xp.sqrt(self.dof * xp.expm1(stretched**2 / self.dof))

    def drawn(self, normal: np.ndarray, random: np.random.Generator) -> np.ndarray:
        return normal / np.sqrt(random.chisquare(self.dof, normal.shape) / self.dof)


FAMILIES: dict[str, Any] = {family.name: family for family in (Normal, StudentT)}


def family_of(options: FitOptions) -> Normal:
    """The family that the options of a fit name."""
    family = FAMILIES[options.noise]
    return family(**{f.name: getattr(options, f"noise_{f.name}") for f in fields(family)})


def over(value: Any) -> Any:
    """A variance of each fit, shaped to broadcast against its points."""
    return value[..., None] if np.ndim(value) else value
