"""One's own code: the C header alone, of whatever law."""

from calibration.handover.choice import HEADER, ITSELF, Carrier
from calibration.handover.exported import Draft

CARRIERS = {
    key: Carrier(HEADER)
    for key in ("linear", "hertz-dashpot", "viscoelastic", "walton-braun", ITSELF)
}
REFUSED: dict[str, tuple[str, str]] = {}
FILES = ("softjax_law.h",)


def files(draft: Draft) -> dict[str, str]:
    """The files of an export by name."""
    return {"softjax_law.h": draft.header}
