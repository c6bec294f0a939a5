"""Zhou's contact law in high-precision arithmetic, independent of the library under test.

Zhou, Theor. Appl. Mech. Lett. 3, 021003 (2013). Good to 40 digits and more, durations to 25.
Nothing is shared with the library: roots are bracketed, works come from antiderivatives of their
own, durations from tanh-sinh quadrature, derivatives from central differences at 140 digits.

Results carry their digits, but arithmetic on them rounds to the caller's `mp.dps` (15 if never
set): work with them inside `mp.workdps(...)`.
"""

from .dimensionless_mp import (
    duration,
    flags,
    loading,
    loading_end,
    loading_work,
    peak,
    plastic_squared,
    residual,
    unloading,
    unloading_work,
    y_max,
)
from .si_mp import (
    NUMBERS,
    QUANTITIES,
    coefficient,
    contact,
    dimensionless,
    empirical,
    equal_spheres,
    log_sensitivities,
    scales,
    second,
)

__all__ = [
    "NUMBERS",
    "QUANTITIES",
    "coefficient",
    "contact",
    "dimensionless",
    "duration",
    "empirical",
    "equal_spheres",
    "flags",
    "loading",
    "loading_end",
    "loading_work",
    "log_sensitivities",
    "peak",
    "plastic_squared",
    "residual",
    "scales",
    "second",
    "unloading",
    "unloading_work",
    "y_max",
]
