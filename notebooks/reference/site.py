"""The site: chapters and notebooks as pages, the packages by pdoc, and what is wrong with them."""

import shutil
from pathlib import Path
from typing import Any

from calibration.commands import fit
from calibration.commands.doctor import write_schemas
from notebooks.reference import links, names, pages

ROOT = Path(__file__).parents[2]
CHAPTERS = Path(__file__).parent
MARKS = "<!-- options of softjax fit -->", "<!-- end of the options -->"


def build(out: Path) -> list[str]:
    """Write the site into `out`; faults found, a line each."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    targets = sources()
    faults = outdated(CHAPTERS / "commands.md")
    for source, name in targets.items():
        text, pictures = pages.page(source, targets)
        (out / name).write_text(text, encoding="utf-8")
        for picture in pictures:
            (out / "figures").mkdir(exist_ok=True)
            shutil.copy(picture, out / "figures" / picture.name)
    for module, text in names.rendered().items():
        path = out / f"{module.replace('.', '/')}.html"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    write_schemas(out)
    faults += [f"{name}: no docstring" for name in names.undocumented()]
    return faults + links.dead(out)


def sources() -> dict[Path, str]:
    """What becomes a page, and the page's name."""
    found = {ROOT / "README.md": "readme.html", ROOT / "CHANGELOG.md": "changelog.html"}
    found |= {path: f"{path.stem}.html" for path in sorted(CHAPTERS.glob("*.md"))}
    return found | {path: f"{path.stem}.html" for path in sorted(ROOT.glob("notebooks/*.ipynb"))}


class _Options(list):
    """Stands in for a parser: a row of a table for each option."""

    def add_argument(self, *names: str, help: str, metavar: Any = None, **_: Any) -> None:
        if not names[0].startswith("-"):
            return
        words = metavar.strip("{}").replace(",", "`, `") if "{" in (metavar or "") else ""
        accepted = f": `{words}`" if words else ""
        text = help.replace("%%", "%").replace("%(const)s", "1000").replace("|", "\\|")
        self.append(f"| `{names[0]}`{accepted} | {text} |")


def outdated(page: Path) -> list[str]:
    """Write the options of `softjax fit` into a page, between the marks; a fault where they changed."""
    rows = _Options(["| option | what it does |", "|---|---|"])
    fit.add_arguments(rows)  # type: ignore[arg-type]
    text = page.read_text(encoding="utf-8")
    before, _, rest = text.partition(MARKS[0])
    new = "\n".join([before + MARKS[0], *rows, MARKS[1] + rest.partition(MARKS[1])[2]])
    if new == text:
        return []
    page.write_text(new, encoding="utf-8")
    return [f"{page.name}: its options of softjax fit were not those of the command; now they are"]
