"""JSON as it is written: what is undefined is null, never NaN."""

import json
import math
from collections.abc import Mapping
from dataclasses import is_dataclass
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """JSON's own types; what is not finite becomes None, a record its fields or its `to_dict`."""
    if hasattr(value, "to_dict"):
        return plain(value.to_dict())
    if is_dataclass(value):
        return plain(vars(value))
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.bool_ | bool):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if value is None or isinstance(value, str):
        return value
    if np.ndim(value):
        return plain(np.asarray(value).tolist())
    number = float(value)
    return number if math.isfinite(number) else None


def dumps(value: Any) -> str:
    """The text of a file."""
    return json.dumps(plain(value), indent=1, ensure_ascii=False) + "\n"
