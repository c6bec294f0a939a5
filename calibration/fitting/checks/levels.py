"""Whether the law misses the level of groups, or one is far from the others."""

import numpy as np
from scipy import special

from calibration.fitting.components import ComponentFit
from calibration.fitting.material import MaterialFit
from calibration.fitting.warnings import CONFIDENCE, Found
from calibration.observables import OBSERVABLES, RESTITUTION

FEWEST_GROUPS = 4  # of which one may be far from the others


def of_levels(fit: ComponentFit, part: MaterialFit, residual) -> Found:
    """Whether the law misses the level of groups, one is far from the others, or the set from a common curve.

    Student's test of the mean of the groups' predicted offsets, Grubbs' of the farthest one; without groups
    Student's of the residuals, where other sets determine the curve too. Offsets are over the standard
    deviations that they have as predictions.

    Source: Grubbs, Ann. Math. Stat. 21, 27 (1950).
    """
    blocks = enumerate(fit.stages[0].problem.blocks)
    of_set = [(k, b) for k, b in blocks if fit.component.specs[b.set].data.name == part.name]
    for k, block in of_set:
        level = fit.offsets[k].missed_level if k in fit.offsets else None
        if level is not None:
            missed = f"by {level:+.2g}"
            if block.observable != RESTITUTION:
                missed = f"in {OBSERVABLES[block.observable].words} by {100 * level:+.2g} %"
            side = "above" if level > 0 else "below"
            cause = f"the law misses the level of the groups {missed}: as a whole they are {side} the curve"
            yield "level", cause
    first = next((k for k, block in of_set if block.observable == RESTITUTION), None)
    if part.group_offsets and first in fit.offsets:
        # in the order of `group_offsets`
        value, _, standard = fit.offsets[first]
        order = np.argsort(-np.abs(value), kind="stable")
        value, standard = value[order], standard[order]
        m = len(standard)
        if m < FEWEST_GROUPS or not np.all(np.isfinite(standard)):
            return
        k = int(np.argmax(np.abs(standard - np.mean(standard))))
        others = np.delete(standard, k)
        spread = np.std(others, ddof=1) * np.sqrt(1 + 1 / (m - 1))
        far = abs(standard[k] - np.mean(others)) / max(spread, 1e-300)
        if far > special.stdtrit(m - 2, 1 - 0.5 * (1 - CONFIDENCE) / m):
            cause = f"group {[*part.group_offsets][k]} is off by {value[k]:.2g}"
            yield "offset", f"{cause}, {far:.2g} times the scatter of the other groups"
        return
    standard, several = np.array(part.standardised), len(fit.component.sets) > 1
    n = len(standard)
    if several and n >= FEWEST_GROUPS and np.ptp(standard) > 0:
        far = abs(np.mean(standard)) / np.std(standard, ddof=1) * np.sqrt(n)
        if far > special.stdtrit(n - 1, 1 - 0.5 * (1 - CONFIDENCE)):
            mean = float(np.mean(residual))
            where = f"{'below' if mean > 0 else 'above'} the curve as a whole"
            yield "offset", f"its points lie {where}, by {abs(mean):.2g} on the average"
