"""A command that writes two files slowly and computes nothing: what befalls it befalls all commands.

python -m tests.slow_command slow --out DIR     # as `softjax slow`
"""

import sys
import time
import types

from calibration import cli
from calibration.atomic import files_into, or_told

NAME = "calibration.commands.slow"
LINES = 40
COMMAND = [sys.executable, "-m", "tests.slow_command", "slow"]


def add_arguments(parser) -> None:
    parser.add_argument("--text", default="new")
    parser.add_argument("--lines", type=int, default=LINES)


def run(arguments) -> int:
    with or_told([f"told: {arguments.text}"]), files_into(arguments.out) as folder:
        print("begun", flush=True)
        for _ in range(arguments.lines):
            for name in ("a", "b"):
                with (folder / name).open("a") as file:
                    file.write(f"{arguments.text}\n" * 100)
            time.sleep(0.005)
    time.sleep(0.1)
    print(f"χ̃ is {arguments.text}")
    return 0


def main() -> int:
    module = types.ModuleType(NAME)
    module.add_arguments, module.run = add_arguments, run  # type: ignore[attr-defined]
    sys.modules[NAME] = module
    cli.COMMANDS["slow"] = "slowly"
    return cli.main([*sys.argv[1:], "--no-cache"])


if __name__ == "__main__":
    raise SystemExit(main())
