"""Names of a package that are loaded when they are asked for, so that importing it costs little."""

import importlib
import sys
from collections.abc import Mapping
from typing import Any


def loaded(package: str, where: Mapping[str, str], name: str) -> Any:
    """What a package's `__getattr__` gives for a name; kept there, so that it is asked once.

    Args:
        where: the module below the package that holds each name.

    Raises:
        AttributeError: for any other name.
    """
    if name not in where:
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{package}.{where[name]}"), name)
    setattr(sys.modules[package], name, value)
    return value
