"""Families of noise: the density of one residual r of variance V, and all that sets one family apart.

A further family is a class that answers all that `Family` asks, smooth at r = 0, an entry of `FAMILIES` and the
same word in `FitOptions.noise`. Its fields are numbers of its own, set by `FitOptions.noise_<field>`; the
places that have `noise_dof` by name are to have it, too. No other room knows which families there are.

Methods with `xp` work for NumPy and for jax.numpy; the others are for searches, in NumPy.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import Any, ClassVar, NamedTuple

import numpy as np
from scipy import special

from calibration.options import FitOptions

LN_2PI = math.log(2 * math.pi)
HEAVY_TAILS = 4.0  # degrees of freedom of Student's t: the default of `noise_dof`
HEAVY_SCALE = 0.831  # √V of these fitted to normal errors, over their standard deviation
RARE = 0.05  # probability that the farthest of n residuals is an outlier


class Family(ABC):
    """Distribution of residuals; V is the variance of normal errors, else the square of a scale."""

    name: ClassVar[str]
    # whether -2 ln p is r²/V: the curve of the largest likelihood is that of least squares, whatever V is; points
    # that share a curve merge into their mean; Σ r²/V is χ², and V is estimated as mean squares are
    is_least_squares: ClassVar[bool]
    has_joint: ClassVar[
        bool
    ]  # whether points may share errors: densities in `Errors` are normal ones

    @property
    @abstractmethod
    def words(self) -> str:
        """Name of the distribution in reports."""

    @property
    @abstractmethod
    def scale_words(self) -> str:
        """Name of √V in reports."""

    @property
    @abstractmethod
    def information(self) -> Any:
        """Fisher's, of the curve in one residual, times V."""

    @abstractmethod
    def variance_of_scale(self, residual_dof: Any) -> Any:
        """Variance of ln V as intervals have it, estimated from so many residual degrees of freedom."""

    @abstractmethod
    def quantile(self, probability: Any) -> Any:
        """Quantile of the residuals r/√V."""

    @abstractmethod
    def normal_of(self, white: Any) -> Any:
        """Standard normal numbers that are as rare as residuals r/√V are."""

    @abstractmethod
    def predictive_degrees(self, degrees: Any) -> Any:
        """Degrees of freedom of t whose quantiles a further point has, if its variance is known with so many."""

    @abstractmethod
    def log_density(self, residual: Any, variance: Any, xp: Any = np) -> Any:
        """ln p of residuals."""

    @abstractmethod
    def log_predictive(self, residual: Any, variance: Any, degrees: Any) -> Any:
        """ln p where the variance is estimated with these degrees of freedom."""

    @abstractmethod
    def squares(self, white: Any) -> Any:
        """-2 ln of p over its largest value, of residuals r/√V."""

    @abstractmethod
    def weight(self, white: Any) -> Any:
        """-∂ln p/∂r V/r: what multiplies r² in least squares of the same gradient."""

    @abstractmethod
    def from_normal(self, normal: Any, xp: Any = np) -> Any:
        """Residuals r/√V as a smooth function of standard normal numbers, one each."""

    @abstractmethod
    def drawn(self, normal: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """Residuals from normal ones of variance V."""

    def farthest(self, count: int) -> float:
        """Size of residuals r/√V from which on one of so many is an outlier."""
        return float(self.quantile(1 - 0.5 * RARE / count))

    @property
    def robust(self) -> "Robust | None":
        """Heavier tails, by which outliers are seen for what they are; None: these are heavy enough."""
        return None


class Robust(NamedTuple):
    """Heavier tails that are fitted in place of normal ones to see which points are apart from the others.

    Attributes:
        family: of these tails.
        scale: √V that they fit to normal errors, over the standard deviation of these.
    """

    family: Family
    scale: float

    def apart(self, count: int, residual_dof: float) -> float:
        """Size r/√V from which on one of so many residuals is apart from others that are normal.

        As of an externally studentised residual: heavy tails are there to bear such a point, and do not explain
        it. Of 27 points 4.2 scales, where the tails themselves allow 7.3 to the farthest.
        """
        rare = 1 - 0.5 * RARE / count
        return float(special.stdtrit(max(residual_dof - 1, 1.0), rare)) / self.scale


@dataclass(frozen=True, eq=False)
class Normal(Family):
    """-2 ln p = r²/V + ln V + ln 2π."""

    name = "normal"
    is_least_squares = True
    has_joint = True
    words = "normal errors"
    scale_words = "estimated standard deviation of a single ε"
    information = 1.0

    def variance_of_scale(self, residual_dof: Any) -> Any:
        return 2 / residual_dof

    def quantile(self, probability: Any) -> Any:
        return special.ndtri(probability)

    def normal_of(self, white: Any) -> Any:
        return white

    def predictive_degrees(self, degrees: Any) -> Any:
        return degrees

    def log_density(self, residual: Any, variance: Any, xp: Any = np) -> Any:
        return -0.5 * (residual**2 / variance + xp.log(variance) + LN_2PI)

    def log_predictive(self, residual: Any, variance: Any, degrees: Any) -> Any:
        finite = np.where(np.isinf(degrees), 1.0, degrees)
        heavy = StudentT(finite).log_density(residual, variance)
        return np.where(np.isinf(degrees), self.log_density(residual, variance), heavy)

    def squares(self, white: Any) -> Any:
        return white**2

    def weight(self, white: Any) -> Any:
        return np.ones_like(white)

    def from_normal(self, normal: Any, xp: Any = np) -> Any:
        return normal

    def drawn(self, normal: np.ndarray, random: np.random.Generator) -> np.ndarray:
        return normal

    @property
    def robust(self) -> Robust:
        return Robust(StudentT(HEAVY_TAILS), HEAVY_SCALE)


@dataclass(frozen=True, eq=False)
class StudentT(Family):
    """-2 ln p = (ν + 1) ln(1 + r²/(ν V)) + ln V - 2 ln c_ν; √V is the scale.

    Source: Lange, Little and Taylor, J. Am. Stat. Assoc. 84, 881 (1989).

    Attributes:
        dof: ν.
    """

    name = "student-t"
    is_least_squares = False
    has_joint = False
    scale_words = "estimated scale of Student's t of a single ε"
    dof: Any

    @property
    def information(self) -> Any:
        return (self.dof + 1) / (self.dof + 3)

    @property
    def words(self) -> str:
        return f"Student's t of {self.dof:.3g} degrees of freedom"

    def variance_of_scale(self, residual_dof: Any) -> Any:
        """Variance of normal errors, which intervals need.

        ln V itself varies by Fisher's 2 (ν + 3)/(ν n): 0.48, 0.33 and 0.147 in 600 sets of 8, 12 and 26 points with
        ν = 4. But the curvature at an estimate that is too small is too large by less: intervals with quantiles of
        these degrees of freedom contained the truth in 97.3, 96.8 and 95.3 %, of 2/n in 95.5, 94.8 and 94.8 %.
        """
        return 2 / residual_dof

    def quantile(self, probability: Any) -> Any:
        return special.stdtrit(self.dof, probability)

    def normal_of(self, white: Any) -> Any:
        rare = special.stdtr(self.dof, -np.abs(white))  # of the near tail, which keeps its digits
        return -np.sign(white) * special.ndtri(rare)

    def predictive_degrees(self, degrees: Any) -> Any:
        return np.minimum(degrees, self.dof)

    def log_density(self, residual: Any, variance: Any, xp: Any = np) -> Any:
        if xp is np:
            from scipy.special import gammaln
        else:
            from jax.scipy.special import gammaln
        nu = self.dof
        level = gammaln(0.5 * (nu + 1)) - gammaln(0.5 * nu) - 0.5 * xp.log(math.pi * nu)
        return (
            level
            - 0.5 * xp.log(variance)
            - 0.5 * (nu + 1) * xp.log1p(residual**2 / (nu * variance))
        )

    def log_predictive(self, residual: Any, variance: Any, degrees: Any) -> Any:
        return self.log_density(residual, variance)

    def squares(self, white: Any) -> Any:
        return (self.dof + 1) * np.log1p(white**2 / self.dof)

    def weight(self, white: Any) -> Any:
        return (self.dof + 1) / (self.dof + white**2)  # which tends to 1 as ν grows

    def from_normal(self, normal: Any, xp: Any = np) -> Any:
        """Map normal numbers in good approximation. Source: Wallace, Ann. Math. Stat. 30, 1124 (1959)."""
        stretched = normal * (8 * self.dof + 3) / (8 * self.dof + 1)
        return xp.sign(normal) * xp.sqrt(self.dof * xp.expm1(stretched**2 / self.dof))

    def drawn(self, normal: np.ndarray, random: np.random.Generator) -> np.ndarray:
        return normal / np.sqrt(random.chisquare(self.dof, normal.shape) / self.dof)


FAMILIES: dict[str, Any] = {family.name: family for family in (Normal, StudentT)}
JOINT = tuple(name for name, family in FAMILIES.items() if family.has_joint)
LEAST_SQUARES = tuple(name for name, family in FAMILIES.items() if family.is_least_squares)


def family_of(options: FitOptions) -> Family:
    """The family that the options of a fit name."""
    family = FAMILIES[options.noise]
    return family(**{f.name: getattr(options, f"noise_{f.name}") for f in fields(family)})


def broadcast_variance(value: Any) -> Any:
    """A variance of each fit, shaped to broadcast against its points."""
    return value[..., None] if np.ndim(value) else value
