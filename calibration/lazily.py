"""Names of a package that are loaded when they are first used, so that importing it costs little.

Which module has each of them is written once, in the package's `__init__.pyi`, where type checkers
and editors look too.
"""

import importlib
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

IMPORT = re.compile(r"^from (\S+) import (\w+) as \2$", re.M)


def public(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of a package, from its stub; each name is loaded once."""
    origin = sys.modules[package].__file__
    assert origin is not None  # packages are folders of files
    stub = Path(origin).with_name("__init__.pyi").read_text(encoding="utf-8")
    where = {name: module for module, name in IMPORT.findall(stub)}

    def loaded(name: str) -> Any:
        if name not in where:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(importlib.import_module(where[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    def known() -> list[str]:
        return sorted({*vars(sys.modules[package]), *where})

    return loaded, known, sorted(where)
