"""The README, and the reference: what they show is what runs, every public name is documented, no link leads nowhere."""

import contextlib
import io
import re
from dataclasses import fields
from pathlib import Path

import pytest

import calibration as cal
import softjax as sj
from calibration.cli import COMMANDS
from notebooks.reference import links, names, site
from tests import records
from tests.command import run
from tests.docs.test_notebooks import NUMBER, assert_alike

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
REFERENCE = ROOT / "notebooks" / "reference"
PAGES = [ROOT / "README.md", *sorted(REFERENCE.glob("*.md"))]


each = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)


def blocks(text, kind):
    return re.findall(rf"```{kind}\n(.*?)```", text, re.S)


def promised(block):
    """The comment lines at a block's end."""
    lines = block.rstrip().splitlines()
    last = next((k for k, line in enumerate(reversed(lines)) if not line.startswith("# ")), 0)
    return "\n".join(line[2:] for line in lines[len(lines) - last :])


def printed(code, names):
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(compile(code, "README", "exec"), names)
    return out.getvalue().strip()


@each
def test_python_prints_what_it_says(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = page.read_text(encoding="utf-8")
    for kind in ("toml", "csv"):
        for block in blocks(text, kind)[:1]:
            (tmp_path / f"my_alloy.{kind}").write_text(block, encoding="utf-8")
    names = {"__name__": "readme"}
    for block in blocks(text, "python"):
        assert "print(" in block
        assert printed(block, names) == promised(block)


@pytest.mark.long
def test_the_tutorial_shows_what_its_fits_print(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "notebooks" / "reference" / "tutorial.md").read_text(encoding="utf-8")
    (toml,), (csv,) = blocks(page, "toml"), blocks(page, "csv")
    first, settings, second = blocks(page, "text")[:3]
    states = (csv, toml, first), (csv.replace("1500,363", "1500,633"), settings + toml, second)
    for rows, material, shown in states:
        Path("my_alloy.csv").write_text(rows, encoding="utf-8")
        Path("my_alloy.toml").write_text(material, encoding="utf-8")
        code, out, _ = run("fit", "my_alloy.toml")
        assert code == 0
        fitted = r"^(?:χ̃|ε_up|air_drag) {2,}.*"
        expected = re.findall(fitted, shown, re.M)
        assert len(expected) >= 3
        known = {re.sub(NUMBER, "#", " ".join(row.split())): row for row in out.splitlines()}
        for row in expected:
            assert_alike(known[re.sub(NUMBER, "#", " ".join(row.split()))], row)


@each
def test_commands_are_accepted_as_they_stand(page):
    text = page.read_text(encoding="utf-8")
    shown = [line for block in blocks(text, "bash") for line in block.splitlines()]
    shown += re.findall(r"`(softjax [a-z]+ [^`\[]*)`", text)
    for line in shown:
        words = line.partition(" #")[0].split()
        if words[:1] == ["softjax"] and "--help" not in words:
            assert accepted(words[1:]), line


def accepted(words) -> bool:
    """Whether the command's help lists its options and their choices."""
    name, *rest = words
    if name not in COMMANDS:
        return False
    text = run(name, "--help")[1]
    options = [word.partition("=")[0] for word in rest if word.startswith("--")]
    return all(re.search(rf"(?<!\S){re.escape(option)}\b", text) for option in options)


def test_material_files_are_read(tmp_path):
    (simulated,) = blocks(README, "csv")
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        shown = re.findall(r"```toml\n([^`]*)```(?:\n```csv\n([^`]*)```)?", text)
        for k, (block, rows) in enumerate(shown):
            file = tmp_path / f"{page.stem}_{k}.toml"
            file.write_text(block, encoding="utf-8")
            (tmp_path / "my_alloy.csv").write_text(rows or simulated, encoding="utf-8")
            problem = cal.read_problem(file)
            assert [data.name for data in problem.datasets] == ["my alloy"]


def test_the_readme_is_short_shows_every_command_and_says_first_what_the_data_are():
    assert len(README.splitlines()) <= 160
    assert len(blocks(README, "python")) == 4
    assert {name for name in COMMANDS if f"`softjax {name}" not in README} == set()
    head = README[: README.index("```bash")]
    assert "published fit of measurements, not measurements" in " ".join(head.split())
    assert "never `pip install softjax`" in head
    assert re.search(r"# (\[0\..*\])", README)[1] in sj.restitution.__doc__


@pytest.mark.parametrize("table", site.tables(), ids=lambda table: table[1][0].strip("<!-> "))
def test_tables_in_pages_are_those_of_the_code(table):
    records.as_table(*table)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    out = tmp_path_factory.mktemp("reference")
    assert site.build(out) == []  # no dead link, no public name without a docstring
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
    text = (REFERENCE / "commands.md").read_text(encoding="utf-8")
    sections = {part.partition("\n")[0]: part for part in re.split(r"^##+ ", text, flags=re.M)}
    common = sections["Common to all"] + sections["Which collision"]
    names = [name for name in sections if name.startswith(f"`softjax {command}")]
    section = "".join(sections[name] for name in names)
    options = set(re.findall(r"(?<!\S)(--[a-z0-9-]+)", run(command, "--help")[1]))
    documented = set(re.findall(r"`(--[a-z0-9-]+)", common + section))
    assert options - documented == {"--help"}


def test_every_warning_and_every_law_with_its_parameters_is_documented():
    source = (ROOT / "calibration" / "fitting" / "warnings.py").read_text("utf-8")
    (table,) = re.findall(r"^ADVICE.*?= \{$(.*?)^\}$", source, re.M | re.S)
    codes = re.findall(r'^    "([a-z0-9-]+)":', table, re.M)
    text = (REFERENCE / "symptoms.md").read_text(encoding="utf-8")
    assert len(codes) > 15
    assert [code for code in codes if f"`{code}`" not in text] == []
    text = (REFERENCE / "laws.md").read_text(encoding="utf-8")
    rows = [row.split(" | ") for row in text.splitlines() if row.startswith("| `")]
    laws = {row[1].strip("`"): set(re.findall(r"`(\w+)`", row[2])) for row in rows if len(row) == 5}
    declared = lambda law: {f.name for f in fields(law) if "declared" in f.metadata}  # noqa: E731
    assert laws == {name: declared(law) for name, law in cal.LAWS.items()}


def test_a_dead_link_and_a_silent_name_are_found(tmp_path, monkeypatch):
    (tmp_path / "a.html").write_text('<a href="b.html#x">b</a><a href="#y">y</a>')
    (tmp_path / "b.html").write_text('<p id="z"><a href="c.html"><img src="data:,">')
    dead = ("a.html: b.html#x", "a.html: #y", "b.html: c.html")
    assert links.dead(tmp_path) == [f"{one} leads nowhere" for one in dead]
    (module,) = [one for one in names.modules().values() if one.modulename == "softjax"]
    monkeypatch.setattr(module.members["restitution"], "docstring", "")
    assert "softjax.restitution" in list(names.undocumented())
