"""All public names with their docstrings, by pdoc."""

import importlib
import re
import sys
from collections.abc import Iterator
from functools import cache
from types import ModuleType

import pdoc
from pdoc import doc, doc_ast, render

LINK = re.compile(r'<a href="#([^"]+)">(.*?)</a>', re.S)
MODULES = ("softjax", "calibration", "calibration.paper")


@cache
def modules() -> dict[str, doc.Module]:
    """The packages as pdoc sees them, names that are loaded when asked for among them."""
    return {name: _documented(importlib.import_module(name)) for name in MODULES}


def rendered() -> dict[str, str]:
    """{module: HTML}."""
    render.configure(docformat="google", show_source=False)
    return {
        name: _shown(pdoc.render.html_module(one, modules())) for name, one in modules().items()
    }


def _shown(page: str) -> str:
    """Without the links that pdoc makes of names which it then shows in no place of the page."""
    anchors = set(re.findall(r'id="([^"]+)"', page))
    return LINK.sub(lambda found: found[0] if found[1] in anchors else found[2], page)


def undocumented() -> Iterator[str]:
    """Public names, and methods of public classes, that do not say what they are."""
    for module in modules().values():
        for member in module.members.values():
            if not member.docstring:
                yield member.fullname
            elif isinstance(member, doc.Class):
                yield from (m.fullname for m in member.own_members if _is_silent(m))


def _is_silent(member: doc.Doc) -> bool:
    """Attributes are told in their class's docstring."""
    is_public = not member.name.startswith("_")
    return is_public and not isinstance(member, doc.Variable) and not member.docstring


def _documented(module: ModuleType) -> doc.Module:
    for name in getattr(module, "__all__", ()):
        getattr(module, name)  # those of `calibration` are loaded when asked for
    found = doc.Module(module)
    for member in found.members.values():
        if isinstance(member, doc.Variable) and not member.docstring:
            member.docstring = _where_assigned(module.__name__, member.name)
    return found


def _where_assigned(package: str, name: str) -> str:
    """A constant's docstring, which stands in the module that it comes from."""
    inside = [one for key, one in sys.modules.items() if key.startswith(f"{package}.")]
    for module in inside:
        if name in vars(module):
            text = doc_ast.walk_tree(module).var_docstrings.get(name)
            if text:
                return text
    return ""
