"""Build the reference as web pages: `python -m notebooks.reference [DIR]`.

Fails where a public name has no docstring, where a link leads nowhere, and at any warning.
"""

import argparse
import sys
import warnings
from pathlib import Path

from notebooks.reference.site import build


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m notebooks.reference", description=__doc__)
    parser.add_argument("out", nargs="?", type=Path, default=Path("build/reference"))
    out = parser.parse_args().out
    warnings.simplefilter("error")
    faults = build(out)
    for fault in faults:
        print(fault, file=sys.stderr)
    if not faults:
        print(f"Written to {out / 'index.html'}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
