"""Families of noise: the density of one residual r of variance V, and what else a fit needs of it.

A further family is a class with the methods of `Normal`, smooth at r = 0, and a word in `FitOptions.noise`.
`Errors`, `MaterialFit` and fit.json know the family as `dof`, None for normal errors: look there for what
tells the two apart (`Errors.family`, `refits`, `curves`, `warnings`, `posterior.draws`, `studies.compare`). A
parameter of its own that is estimated gets its start in `variances.first_variances`, its name in
`errors.CALLED` and its prior in `posterior/density.py`, as "dof" has.

Methods with `xp` work for NumPy and for jax.numpy; the others are for searches, in NumPy.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

LN_2PI = math.log(2 * math.pi)


class Normal:
    """-2 ln p = r²/V + ln V + ln 2π."""

    dof: Any = None
    information: Any = 1.0  # Fisher's, of one residual, times V

    def log_density(self, off: Any, variance: Any, xp: Any = np) -> Any:
        """ln p of residuals."""
        return -0.5 * (off**2 / variance + xp.log(variance) + LN_2PI)

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
        dof: ν, a number or one for each residual.
    """

    dof: Any

    @property
    def information(self) -> Any:  # type: ignore[override]
        return (self.dof + 1) / (self.dof + 3)

    def log_density(self, off: Any, variance: Any, xp: Any = np) -> Any:
        if xp is np:
            from scipy.special import gammaln
        else:
            from jax.scipy.special import gammaln
        nu = self.dof
        level = gammaln(0.5 * (nu + 1)) - gammaln(0.5 * nu) - 0.5 * xp.log(math.pi * nu)
        return level - 0.5 * xp.log(variance) - 0.5 * (nu + 1) * xp.log1p(off**2 / (nu * variance))

    def squares(self, white: Any) -> Any:
        return (self.dof + 1) * np.log1p(white**2 / self.dof)

    def weight(self, white: Any) -> Any:
        return (self.dof + 1) / (self.dof + white**2)  # which tends to 1 as ν grows

    def from_normal(self, normal: Any, xp: Any = np) -> Any:
        """The same in good approximation. Source: Wallace, Ann. Math. Stat. 30, 1124 (1959)."""
        stretched = normal * (8 * self.dof + 3) / (8 * self.dof + 1)
        return xp.sign(normal) * xp.sqrt(self.dof * xp.expm1(stretched**2 / self.dof))

    def drawn(self, normal: np.ndarray, random: np.random.Generator) -> np.ndarray:
        nu = float(np.max(self.dof))
        return normal / np.sqrt(random.chisquare(nu, normal.shape) / nu)
