"""The site: chapters and notebooks as pages, the packages by pdoc, and what is wrong with them."""

import shutil
from pathlib import Path

from calibration.commands.doctor import write_schemas
from notebooks.reference import links, names, pages

ROOT = Path(__file__).parents[2]
CHAPTERS = Path(__file__).parent


def build(out: Path) -> list[str]:
    """Write the site into `out`; faults found, a line each."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    targets = sources()
    faults = []
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
