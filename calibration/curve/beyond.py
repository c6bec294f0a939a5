"""How far a fit's curve goes beyond the data it was fitted to, in one line."""

import numpy as np

from calibration.curve.source import Source
from calibration.errors import printable

WIDEST = (1.234e-100, 1.234e-100)  # m/s: no velocity takes more letters


def beyond_data(source: Source, ends: tuple[float, float]) -> str | None:
    """The warning where velocities from `ends` lie outside the data of a fit; else None."""
    doubt = None if source.result is None else source.result.extrapolation(ends, source.name)
    return None if doubt is None else beyond_text(source, ends)


def beyond_text(source: Source, ends: tuple[float, float]) -> str:
    """From where to where curve and data go."""
    velocity = source.result.material(source.name).data.velocity
    curve, data = (
        f"{np.min(v):.4g} to {np.max(v):.4g} m/s" for v in (np.array(ends), np.asarray(velocity))
    )
    name = printable(source.name)
    return f"extrapolation: the curve goes from {curve}, the data of {name} from {data}"
