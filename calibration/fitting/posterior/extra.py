"""The packages that only a posterior needs."""

import importlib
import warnings
from typing import Any

from calibration.errors import InputError

INSTALL = 'pip install -e ".[bayes]" in its folder'


class MissingExtra(InputError, ImportError):
    """A package of the extra `bayes` is not installed; one line says what to do."""


def needed(name: str) -> Any:
    """A module of the extra.

    Raises:
        MissingExtra: where it is not installed.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)  # ArviZ 0.23 announces 1.0
            return importlib.import_module(name)
    except ModuleNotFoundError as error:
        package = name.partition(".")[0]
        if error.name is None or error.name.partition(".")[0] != package:
            raise
        problem = f"a posterior needs {package}, which is not installed"
        raise MissingExtra(None, None, problem, f"install it with {INSTALL}") from None
