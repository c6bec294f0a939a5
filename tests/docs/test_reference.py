"""The reference is built whole: every public name documented, no link that leads nowhere."""

import re
from dataclasses import fields
from pathlib import Path

import pytest

import calibration as cal
import softjax as sj
from notebooks.reference import links, names, site
from tests.docs.test_readme import COMMANDS, helped

CHAPTERS = Path(__file__).parents[2] / "notebooks" / "reference"


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    out = tmp_path_factory.mktemp("reference")
    assert site.build(out) == []
    return out


@pytest.mark.parametrize("package", [sj, cal], ids=["softjax", "calibration"])
def test_every_public_name_has_its_place_with_its_docstring(built, package):
    text = (built / f"{package.__name__}.html").read_text(encoding="utf-8")
    for name in package.__all__:
        place = text.partition(f'<section id="{name}">')[2].partition("</section>")[0]
        assert 'class="docstring"' in place, name


def test_chapters_and_notebooks_are_pages_with_links_between_them(built):
    pages = {path.stem for path in built.glob("*.html")}
    assert {"index", "readme", "changelog", "how_it_works", "6_sensitivity"} <= pages
    text = (built / "6_sensitivity.html").read_text(encoding="utf-8")
    assert text.count("data:image/png;base64,") == 3
    assert "<math" in text  # formulas need nothing of the web
    text = (built / "readme.html").read_text(encoding="utf-8")
    assert 'href="measurements.html"' in text
    assert 'src="figures/curves.png"' in text
    assert (built / "figures" / "curves.png").is_file()
    assert not re.search(r'href="[^"]*\.(md|ipynb)', text)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_of_a_command_is_told(command):
    text = (CHAPTERS / "commands.md").read_text(encoding="utf-8")
    sections = {part.partition("\n")[0]: part for part in re.split(r"^##+ ", text, flags=re.M)}
    common = sections["Common to all"] + sections["Which collision"]
    names = [name for name in sections if name.startswith(f"`softjax {command}")]
    section = "".join(sections[name] for name in names) + sections["Velocities and files"] * (
        command == "curve"
    )
    options = set(re.findall(r"(?<!\S)(--[a-z0-9-]+)", helped(command)))
    documented = set(re.findall(r"`(--[a-z0-9-]+)", common + section))
    assert options - documented == {"--help"}


def test_every_warning_and_every_law_with_its_parameters_is_documented():
    source = (CHAPTERS.parents[1] / "calibration" / "fitting" / "warnings.py").read_text("utf-8")
    (table,) = re.findall(r"^ADVICE.*?= \{$(.*?)^\}$", source, re.M | re.S)
    codes = re.findall(r'^    "([a-z0-9-]+)":', table, re.M)
    text = (CHAPTERS / "symptoms.md").read_text(encoding="utf-8")
    assert len(codes) > 15
    assert [code for code in codes if f"`{code}`" not in text] == []
    text = (CHAPTERS / "laws.md").read_text(encoding="utf-8")
    rows = [row.split(" | ") for row in text.splitlines() if row.startswith("| `")]
    laws = {row[1].strip("`"): set(re.findall(r"`(\w+)`", row[2])) for row in rows if len(row) == 5}
    assert laws == {
        name: {f.name for f in fields(law) if "declared" in f.metadata}
        for name, law in cal.LAWS.items()
    }


def test_a_dead_link_and_a_silent_name_are_found(tmp_path, monkeypatch):
    (tmp_path / "a.html").write_text('<a href="b.html#x">b</a><a href="#y">y</a>')
    (tmp_path / "b.html").write_text('<p id="z"><a href="c.html"><img src="data:,">')
    assert links.dead(tmp_path) == [
        "a.html: b.html#x leads nowhere",
        "a.html: #y leads nowhere",
        "b.html: c.html leads nowhere",
    ]
    (module,) = [one for one in names.modules().values() if one.modulename == "softjax"]
    monkeypatch.setattr(module.members["restitution"], "docstring", "")
    assert "softjax.restitution" in list(names.undocumented())
