"""The packages that only a posterior needs."""

import importlib
from typing import Any

INSTALL = 'pip install "softjax-contact[bayes]"'


class MissingExtra(ImportError):
    """A package of the extra `bayes` is not installed; one line says what to do."""


def needed(name: str) -> Any:
    """A module of the extra.

    Raises:
        MissingExtra: where it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        package = name.partition(".")[0]
        if error.name is None or error.name.partition(".")[0] != package:
            raise
        told = f"a posterior needs {package}, which is not installed: {INSTALL}"
        raise MissingExtra(told, name=package) from None
