"""Springs as codes are told them: softer at the same ε, or unloading steeper the deeper they were.

Softer: overlaps and durations grow by a factor, forces fall by it. With P'(δ, δ') = P(δ/μ, δ')/μ
every impact is the old one with lengths and times μ times as large, so that ε(v) is untouched. What
it costs: overlaps, and whatever a larger overlap means for a scene.
"""

import dataclasses
from typing import Any

import softjax as sj
from calibration.particle_codes.target import number_of

BEYOND = 2.0  # the overlap up to which k2 grows, over the largest wanted


def softened(law: Any, factor: float) -> Any:
    """A law whose fields can say it, softer by `factor`.

    Raises:
        TypeError: for laws that are handed over by a header, which softens by itself.
    """
    if factor == 1:
        return law
    if isinstance(law, sj.LinearSpringDashpot):
        return dataclasses.replace(law, stiffness=law.stiffness / factor**2)
    if isinstance(law, sj.WaltonBraun):
        return dataclasses.replace(
            law,
            loading_stiffness=law.loading_stiffness / factor**2,
            unloading_stiffness=law.unloading_stiffness / factor**2,
            growth=law.growth / factor,
        )
    if not isinstance(law, sj.HertzDashpot | sj.ViscoelasticHertz):
        raise TypeError(f"no fields of {type(law).__name__} say how soft it is")
    modulus = law.contact.youngs_modulus / factor**2.5
    law = dataclasses.replace(law, contact=dataclasses.replace(law.contact, youngs_modulus=modulus))
    if isinstance(law, sj.HertzDashpot):
        return law
    return dataclasses.replace(law, dissipation_time=law.dissipation_time * factor)


def growth_of(law: sj.WaltonBraun, peak: float) -> tuple[float, float]:
    """k_p/k1 and the plasticity depth over the radii, where k2 = k1 (1 + s δ) up to `BEYOND` peaks.

    As LIGGGHTS and YADE take them, without adhesion.
    """
    most = 1 + number_of(law.growth) * BEYOND * peak
    return most, BEYOND * peak * (most - 1) / most / (2 * number_of(law.contact.radius))
