"""The README's example prints what the README says."""

import contextlib
import io
import re
from pathlib import Path

import softjax as sj
from calibration import cli

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_python_examples():
    """The second goes on from the first."""
    blocks = re.findall(r"```python\n(.*?)```", README, re.S)
    names = {"__name__": "readme"}
    for block in (next(b for b in blocks if word in b) for word in ("enable_x64", "class ")):
        *code, promised = block.strip().splitlines()
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec("\n".join(code), names)
        assert printed.getvalue().strip() == promised.removeprefix("# ")


def test_docstring_example_is_the_readme_s():
    promised = re.search(r"# (\[0\..*\])", README).group(1)
    assert promised in sj.restitution.__doc__


def test_first_lines_say_what_the_data_are():
    head = README[: README.index("```bash")]
    assert "published fit of measurements, not measurements" in " ".join(head.split())
    assert "never `pip install softjax`" in head


def test_commands_are_accepted_as_they_stand():
    blocks = "\n".join(re.findall(r"```bash\n(.*?)```", README, re.S))
    lines = [line.split() for line in blocks.splitlines() if line.startswith("softjax ")]
    told = {cli._parse(words[1:])[0] for words in lines}
    assert told >= {"fit", "curve", "sensitivity", "compare"}


def test_pictures_and_notebooks_are_there():
    links = re.findall(r"\]\(([^)#]+)\)", README)
    assert len(links) > 12
    assert [link for link in links if not (ROOT / link).is_file()] == []
