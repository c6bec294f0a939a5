"""Springs as codes take them: softer at the same ε, or unloading more steeply from deeper overlaps.

Softer: overlaps and durations grow by a factor, forces fall by it. With P'(δ, δ') = P(δ/μ, δ')/μ
every impact is the old one with lengths and times μ times as large, so that ε(v) is untouched. What
it costs: overlaps, and whatever a larger overlap means for a scene.
"""

import dataclasses
from typing import Any

import softjax as sj
from calibration.particle_codes.target import number_of

BEYOND = 2.0  # the overlap up to which k2 grows, over the largest of the range
POWERS = {  # of the factor, by which a field is multiplied
    sj.LinearSpringDashpot: {"stiffness": -2},
    sj.WaltonBraun: {"loading_stiffness": -2, "unloading_stiffness": -2, "growth": -1},
    sj.HertzDashpot: {},
    sj.ViscoelasticHertz: {"dissipation_time": 1},
}
OF_MODULUS = sj.HertzDashpot, sj.ViscoelasticHertz


def softened(law: Any, factor: float) -> Any:
    """A law softer by `factor`, by its fields; headers soften any law by themselves."""
    if factor == 1:
        return law
    fields = {name: getattr(law, name) * factor**power for name, power in POWERS[type(law)].items()}
    if isinstance(law, OF_MODULUS):
        modulus = law.contact.youngs_modulus / factor**2.5
        fields["contact"] = dataclasses.replace(law.contact, youngs_modulus=modulus)
    return dataclasses.replace(law, **fields)


def growth_of(law: sj.WaltonBraun, peak: float) -> tuple[float, float]:
    """k_p/k1 and the plasticity depth over the radii, where k2 = k1 (1 + s δ) up to `BEYOND` peaks.

    As LIGGGHTS and YADE take them, without adhesion.
    """
    most = 1 + number_of(law.growth) * BEYOND * peak
    return most, BEYOND * peak * (most - 1) / most / (2 * number_of(law.contact.radius))
