"""What commands show, each run once: their pictures, text and files."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from tests.cases import pair
from tests.command import BODIES, run
from tests.shown.capture import drawn
from tests.shown.tables import Tags

VELOCITY = np.geomspace(0.2, 30.0, 24)
NOISE = 0.01 * np.random.default_rng(5).standard_normal(24)
MADE = 1 / np.sqrt(1.1 + 0.02 * VELOCITY) + NOISE  # Walton and Braun's 1/ε² = a + b v
MASS = float(pair("nylon").mass)


@dataclass(frozen=True)
class Shown:
    """One command: exit code, text, messages, folder of its files, figures by file name."""

    code: int
    out: str
    err: str
    folder: Path
    figures: dict[str, Figure]

    @property
    def everything(self) -> dict[str, Figure | str]:
        """Pictures, and what is printed and reported in words."""
        pages = [path.name for path in self.folder.glob("*.html")]
        reports = {name: "\n\n".join(self.page(name).paragraphs) for name in pages}
        return {**self.figures, "printed": self.out, **reports}

    def page(self, name: str = "report.html") -> Tags:
        return Tags(self.text(name))

    def text(self, name: str) -> str:
        return (self.folder / name).read_text(encoding="utf-8")


def write(folder: Path, name: str = "alloy", settings: str = "", toml: str | None = None) -> Path:
    """A material file of the 24 impacts with stated errors."""
    rows = [f"{v!r},{e!r},0.01" for v, e in zip(VELOCITY.tolist(), MADE.tolist(), strict=True)]
    text = "\n".join(["velocity [m/s],restitution,uncertainty", *rows])
    (folder / f"{name}.csv").write_text(text + "\n", encoding="utf-8")
    content = f'[fit]\n{settings}\n{BODIES}data = "{name}.csv"\n' if toml is None else toml
    (folder / f"{name}.toml").write_text(content, encoding="utf-8")
    return folder / f"{name}.toml"


def shown(folder: Path, *argv, quiet: bool = False) -> Shown:
    """Run a command that writes into `folder`/out."""
    with drawn() as figures:
        code, out, err = run(*argv, "--out", folder / "out", *["--quiet"] * quiet)
    return Shown(code, out, err, folder / "out", figures)


def reported(result, folder: Path) -> Shown:
    """What `report` of a fit writes into `folder`/out."""
    with drawn() as figures:
        result.report(folder / "out")
    return Shown(0, str(result), "", folder / "out", figures)


@pytest.fixture(scope="session")
def alloy(tmp_path_factory):
    """Walton and Braun's law fitted, with profiles."""
    folder = tmp_path_factory.mktemp("alloy")
    return shown(folder, "fit", write(folder), "--law", "walton-braun")


@pytest.fixture(scope="session")
def main_job(tmp_path_factory):
    return shown(tmp_path_factory.mktemp("paper"), "fit", "--no-profiles")


@pytest.fixture(scope="session")
def compared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compared")
    laws = "walton-braun,eq-17,thornton,thornton-fixed,constant,hertz"
    return shown(folder, "compare", write(folder, settings="profiles = false"), "--laws", laws)


@pytest.fixture(scope="session")
def studied(tmp_path_factory):
    few = ("--points", "9", "--at", "1", "10", "--shots", "6")
    few += ("--from", "0.1", "--to", "60", "--seed", "2")
    return shown(tmp_path_factory.mktemp("studied"), "sensitivity", "nylon", "--study", "all", *few)
