"""Write the sentences of `sentences.txt` again: `python -m tests.refusals`, then read the difference.

A case of the table joins by a line with its way and name, `CSV files | no rows |`.
"""

import tempfile
from pathlib import Path

from tests.refusals.table import refusal

FILE = Path(__file__).with_name("sentences.txt")
FOLDER = "FOLDER"


def sentences() -> dict[tuple[str, str], str]:
    """The sentences that are kept, by way and name."""
    lines = FILE.read_text(encoding="utf-8").splitlines()
    parts = [line.split(" | ", 2) for line in lines if line and line[0] != "#"]
    return {(way, name.removesuffix(" |")): "".join(rest) for way, name, *rest in parts}


def sentence(way: str, name: str, folder: Path) -> str:
    """What is said now; the folder by a word."""
    return str(refusal(way, name, folder)).replace(str(folder), FOLDER)


def main() -> None:
    kept = sentences()
    with tempfile.TemporaryDirectory() as folder:
        lines = [f"{way} | {name} | {sentence(way, name, Path(folder))}" for way, name in kept]
    FILE.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
