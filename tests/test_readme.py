"""The README's example prints what the README says."""

import contextlib
import io
import re
from pathlib import Path

import softjax as sj

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def test_python_example():
    block = next(b for b in re.findall(r"```python\n(.*?)```", README, re.S) if "enable_x64" in b)
    *code, promised = block.strip().splitlines()
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec("\n".join(code), {})
    assert printed.getvalue().strip() == promised.removeprefix("# ")


def test_docstring_example_is_the_readme_s():
    promised = re.search(r"# (\[0\..*\])", README).group(1)
    assert promised in sj.restitution.__doc__


def test_first_lines_say_what_the_data_are():
    head = README[: README.index("```bash")]
    assert "published fit of measurements, not measurements" in " ".join(head.split())
    assert "never `pip install softjax`" in head
