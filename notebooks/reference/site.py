"""The site: chapters and notebooks as pages, the packages by pdoc, and what is wrong with them."""

import argparse
import shutil
from pathlib import Path
from typing import Any

from calibration.commands import compare, curve, export, fit, sensitivity
from calibration.commands.doctor import write_schemas
from calibration.commands.source_options import add_route_arguments, add_source_arguments
from calibration.data import kinds
from calibration.data.columns import OBSERVED, QUANTITIES
from notebooks.reference import links, names, pages

ROOT = Path(__file__).parents[2]
CHAPTERS = Path(__file__).parent
SETS = "<!-- sets of columns -->", "<!-- end of the sets -->"
COLUMNS = "<!-- columns -->", "<!-- end of the columns -->"


def build(out: Path) -> list[str]:
    """Write the site into `out`; faults found, a line each."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    targets = sources()
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
    return [f"{name}: no docstring" for name in names.undocumented()] + links.dead(out)


def tables() -> list[tuple[Path, tuple[str, str], list[str]]]:
    """Tables in pages that are made of the code: page, the marks around the table, its rows."""
    commands, measurements = CHAPTERS / "commands.md", CHAPTERS / "measurements.md"
    return [
        *((commands, _marks(name), rows) for name, rows in options().items()),
        (measurements, SETS, sets()),
        (measurements, COLUMNS, columns()),
    ]


def sources() -> dict[Path, str]:
    """What becomes a page, and the page's name."""
    found = {ROOT / "README.md": "readme.html", ROOT / "CHANGELOG.md": "changelog.html"}
    found |= {path: f"{path.stem}.html" for path in sorted(CHAPTERS.glob("*.md"))}
    return found | {path: f"{path.stem}.html" for path in sorted(ROOT.glob("notebooks/*.ipynb"))}


class _Options(list):
    """Stands in for a parser: a row of a table for each option."""

    def add_argument_group(self, _: str) -> "_Options":
        return self

    def add_argument(
        self,
        name: str,
        help: str = "",
        metavar: Any = None,
        choices: Any = (),
        action: Any = None,
        **_: Any,
    ) -> None:
        title = f"`{name if name.startswith('-') else metavar}`"
        title += f", `--no-{name[2:]}`" * (action is argparse.BooleanOptionalAction)
        words = metavar.strip("{}").split(",") if "{" in (metavar or "") else choices
        accepted = f": {', '.join(f'`{word}`' for word in words)}" if words else ""
        text = help.replace("%%", "%").replace("%(const)s", "1000").replace("|", "\\|")
        self.append(f"| {title}{accepted} | {text} |")


def options() -> dict[str, list[str]]:
    """The options of each command, and those that say which collision, as the rows of tables."""
    of_fit, collision, found = _Options(), _Options(), {}
    fit.add_arguments(of_fit)  # type: ignore[arg-type]
    add_source_arguments(collision)  # type: ignore[arg-type]
    add_route_arguments(collision)  # type: ignore[arg-type]
    for command in (curve, sensitivity, export, compare):
        of_command = _Options()
        command.add_arguments(of_command)
        rows = [row for row in of_command if row not in {*of_fit, *collision}]
        found[f"softjax {command.__name__.rpartition('.')[2]}"] = rows
        as_in_fit = ", ".join(
            row.split(": ")[0].split(" |")[0][2:] for row in of_command if row in of_fit
        )
        if as_in_fit:
            rows.append(f"| {as_in_fit} | as in `softjax fit` |")
    tables = {"softjax fit": of_fit, "which collision": collision, **found}
    head = ["| option | what it does |", "|---|---|"]
    return {name: [*head, *rows] for name, rows in tables.items()}


def _marks(name: str) -> tuple[str, str]:
    """The marks around a table of options."""
    return f"<!-- options: {name} -->", f"<!-- end of options: {name} -->"


def sets() -> list[str]:
    """Columns that make a set, as the rows of a table."""
    rows = ["| columns | ε and v | uncertainties |", "|---|---|---|"]
    for kind in (*kinds.SETS, *kinds.WITHOUT_RESTITUTION, kinds.PEAKS, kinds.TIMES):
        uncertainties = ", ".join(f"`{name}`" for name in kind.uncertainties)
        also = f" with one or more of {', '.join(OBSERVED)}" * (not kind.has_restitution)
        named = kind.named + also
        rows.append(
            f"| {named} | {kind.formula} | {uncertainties or '`uncertainty`, `velocity_uncertainty`'} |"
        )
    return rows


def columns() -> list[str]:
    """Columns with all their spellings, as the rows of a table."""
    rows = ["| column | unit | what it is | also read as |", "|---|---|---|---|"]
    for column in QUANTITIES:
        also = ", ".join(f"`{word.replace('_', ' ')}`" for word in column.spellings.split())
        unit = {"1": "- or %", "": "text"}.get(column.unit, column.unit)
        rows.append(f"| `{column.name}` | {unit} | {column.meaning} | {also} |")
    return rows
