"""The notebooks run, and what is stored in them is what they give."""

import base64
import io
import re
from pathlib import Path

import matplotlib.image
import nbformat
import numpy as np
import pytest
from ipykernel.kernelspec import get_kernel_dict
from jupyter_client import AsyncKernelManager
from jupyter_client.kernelspec import KernelSpec, KernelSpecManager
from nbclient import NotebookClient

from tests.export.lammps import needs_lammps

FOLDER = Path(__file__).parents[2] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
SECTIONS = ["Question", "Model", "Figure", "Reading"]
BY_LAMMPS = "8_into_a_particle_code"
OF_THE_MACHINE = "4_speed_against_error"  # its times are another's on another machine
LARGEST = 300_000  # bytes
CELL_SECONDS = 300  # for a machine that is busy with much else
NUMBER = r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
SOMEBODYS_PATH = r"/(home|root|tmp|Users|work)/|:\\+Users"

each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


class Specifications(KernelSpecManager):
    def get_kernel_spec(self, kernel_name):
        return KernelSpec(**get_kernel_dict())


class ThisInterpreter(AsyncKernelManager):
    """The kernel of the Python that runs the tests, whatever else calls itself `python3` here."""

    def __init__(self, **options):
        super().__init__(kernel_spec_manager=Specifications(), **options)


def execute(notebook, folder, monkeypatch):
    """Run all cells in place; raises at the first that fails."""
    for name in ("IPYTHONDIR", "JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR"):
        monkeypatch.setenv(name, str(folder))  # neither a user's own settings nor traces of a run
    kernel = {"kernel_name": "python3", "kernel_manager_class": ThisInterpreter}
    resources = {"metadata": {"path": str(folder)}}
    return NotebookClient(notebook, timeout=CELL_SECONDS, resources=resources, **kernel).execute()


def outputs(notebook, kind=None):
    cells = (cell for cell in notebook.cells if cell.cell_type == "code")
    found = [output for cell in cells for output in cell.outputs]
    return [o for o in found if kind is None or o.output_type == kind]


def figures(notebook):
    shown = [output.data for output in outputs(notebook) if "data" in output]
    return [base64.b64decode(data["image/png"]) for data in shown if "image/png" in data]


def printed(notebook, stream="stdout"):
    return "".join(o.text for o in outputs(notebook, "stream") if o.name == stream)


def read(path):
    return nbformat.read(path, as_version=4)


@pytest.mark.long
@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=[needs_lammps] * (path.stem == BY_LAMMPS), id=path.stem)
        for path in NOTEBOOKS
    ],
)
def test_runs_and_gives_what_is_stored(path, tmp_path, monkeypatch):
    stored, fresh = read(path), execute(read(path), tmp_path, monkeypatch)
    assert not outputs(fresh, "error")
    assert len(figures(fresh)) == len(figures(stored))
    if path.stem != OF_THE_MACHINE:
        assert_alike(printed(fresh), printed(stored))


def assert_alike(fresh, stored):
    """The same words, and numbers within 2 % or two of their last digit."""
    assert re.sub(NUMBER, "#", fresh).split() == re.sub(NUMBER, "#", stored).split()
    for ours, theirs in zip(re.findall(NUMBER, fresh), re.findall(NUMBER, stored), strict=True):
        decimals = len(theirs.partition("e")[0].partition(".")[2])
        exponent = float(theirs.partition("e")[2] or 0)
        last_digit = 10 ** (exponent - decimals)
        assert float(ours) == pytest.approx(float(theirs), rel=0.02, abs=2.01 * last_digit)


@each
def test_has_its_shape_and_is_stored_executed_with_its_figures(path):
    notebook = read(path)
    text = "\n".join(c.source for c in notebook.cells if c.cell_type == "markdown")
    assert [path.stem[0] for path in NOTEBOOKS] == list("123456789")
    assert re.findall(r"^## (.+)$", text, re.M) == SECTIONS
    assert len(re.findall(r"^# (.+)$", text, re.M)) == 1
    model = text[text.index("## Model") : text.index("## Figure")]
    assert "$$" in model  # an equation
    nbformat.validate(notebook)
    assert figures(notebook)
    assert not outputs(notebook, "error")
    assert not printed(notebook, "stderr")  # warnings
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert notebook.metadata.kernelspec.name == "python3"
    assert not any("execution" in cell.metadata for cell in notebook.cells)  # no times
    assert not re.search(SOMEBODYS_PATH, path.read_text(encoding="utf-8"))
    assert path.stat().st_size < LARGEST
    picture = matplotlib.image.imread(FOLDER / "figures" / f"{path.stem}.png")
    drawn = [matplotlib.image.imread(io.BytesIO(png)) for png in figures(notebook)]
    same_size = [one for one in drawn if one.shape[:2] == picture.shape[:2]]
    assert any(np.abs(one[..., :3] - picture[..., :3]).mean() < 0.003 for one in same_size)


@each
def test_the_reading_names_numbers_that_were_printed(path):
    notebook = read(path)
    *above, reading = notebook.cells
    shown = printed(notebook) + "\n".join(cell.source for cell in above)
    known = set(re.findall(NUMBER, shown))
    named = [n for n in re.findall(NUMBER, reading.source) if "." in n or "e" in n]
    assert named
    assert not [number for number in named if number not in known]
