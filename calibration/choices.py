"""What commands and files may choose of, in words. Nothing is imported here: `--help` needs it."""

from collections.abc import Callable, Mapping
from typing import Any

LAWS = (
    "zhou",
    "thornton",
    "walton-braun",
    "viscoelastic",
    "hertz",
    "hertz-dashpot",
    "linear",
    "constant",
    "eq-17",
)
CHOICES: dict[str, tuple[Any, ...]] = {
    "law": LAWS,
    "objective": ("model", "two-step"),
    "optimiser": ("l-bfgs", "adam", "levenberg-marquardt"),
    "loss": ("squared", "huber", "soft-l1"),
    "route": ("ode", "energy balance", "closed form"),
    "form": ("first-order", "full"),
    "kappa": ("consistent", "printed"),
    "end": ("zero-overlap", "zero-force"),
    "area": ("zhou", "hertz"),
    # Eq. (18) through all curves, through the fitted χ̃, or not at all
    "unloading_line": ("curves", "weighted", "none"),
    "profiles": (True, False),
    "extra_scatter": (True, False),
    "scale_uncertainty": (True, False),
}
# of a law, and the laws that have it
OPTIONS = {"form": ("zhou",), "kappa": ("zhou",), "end": ("hertz-dashpot", "linear")}
COUNTS = {"seed": 0, "starts": 1, "max_steps": 1}  # and the smallest that is accepted
NUMBERS: dict[str, tuple[Callable[[float], bool], str]] = {
    "rtol": (lambda x: 1e-14 <= x <= 0.1, "a number in [1e-14, 0.1]"),
    "confidence": (lambda x: 0 < x < 1, "a number between 0 and 1, such as 0.95"),
    "loss_scale": (lambda x: x > 0, "a positive number, in standard errors of the residuals"),
}
# what acts beside some values of another setting only
ACTS_WITH: dict[str, tuple[str, tuple[Any, ...]]] = {
    "rtol": ("route", (None, "ode")),
    "loss_scale": ("loss", ("huber", "soft-l1")),
}
FORMER = {"empirical": "eq-17", "constant": "constant"}  # objectives that are laws now


def idle(settings: Mapping[str, Any]) -> dict[str, str]:
    """Settings that would do nothing, each with what they act with."""
    found = {}
    for name, (other, acting) in ACTS_WITH.items():
        if name in settings and settings.get(other) not in acting:
            words = " or ".join(f'"{one}"' for one in acting if one)
            found[name] = f"it acts with {other} = {words} only"
    return found
