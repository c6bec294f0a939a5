"""The README, and the chapters of the reference: what they show is what runs."""

import contextlib
import io
import re
from functools import cache
from pathlib import Path

import pytest

import calibration as cal
import softjax as sj
from calibration import cli
from tests.command import run
from tests.docs.test_notebooks import NUMBER, assert_alike

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
CHAPTERS = sorted((ROOT / "notebooks" / "reference").glob("*.md"))
PAGES = [ROOT / "README.md", *CHAPTERS]

COMMANDS = ("curve", "sensitivity", "fit", "compare", "export", "speed", "doctor")

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
        fitted = r"^(?:my alloy|all together)? +[\wχ̃]+  .*"
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
    text = helped(name)
    options = [word.partition("=")[0] for word in rest if word.startswith("--")]
    return all(re.search(rf"(?<!\S){re.escape(option)}\b", text) for option in options)


@cache
def helped(name) -> str:
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.suppress(SystemExit):
        cli.main([name, "--help"])
    return out.getvalue()


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


@each
def test_links_lead_to_files(page):
    text = page.read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)#\s]+)", text) if "://" not in link]
    assert [link for link in links if not (page.parent / link).is_file()] == []
