"""The command `softjax`: finds the subcommand, tells refusals in one line, gives the exit code.

    0   done
    1   a fit did not converge; its results are written, and marked
    2   unusable input: one line on standard error, nothing written

Nothing heavy is imported before a subcommand runs, so that `softjax --help` answers at once.
"""

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from calibration.cache import keep_compilations
from calibration.commands import COMMANDS
from calibration.errors import DataError, InputError, did_you_mean, listed

DONE, NOT_CONVERGED, UNUSABLE, INTERRUPTED = 0, 1, 2, 130
COMMON = {"out": Path("results"), "quiet": False, "cache": True}


class Parser(argparse.ArgumentParser):
    """Says in one line what is wrong, without the whole usage before it."""

    def error(self, message: str):
        line = " ".join(message.split())
        self.exit(UNUSABLE, f"{self.prog}: {line}; {self.prog} --help lists what is accepted\n")


class Version(argparse.Action):
    """Looks the version up when it is asked for: it is in a file of the installed distribution."""

    def __call__(self, parser, *_):
        from importlib.metadata import version

        print(f"softjax-contact {version('softjax-contact')}")
        parser.exit(DONE)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line; returns the exit code."""
    _never_fail_to_print()
    name, arguments = _parse(sys.argv[1:] if argv is None else argv)
    try:
        if arguments.cache:
            keep_compilations()
        return _command(name).run(arguments)
    except (InputError, DataError) as error:
        return _refuse(str(error))
    except KeyboardInterrupt:
        print(f"softjax {name}: interrupted, nothing written", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # `softjax fit | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE


def common_options(parser: argparse.ArgumentParser) -> None:
    """`--out` and `--quiet`, which may stand before or behind the command."""
    group = parser.add_argument_group("common options")
    group.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        default=argparse.SUPPRESS,
        help="where results are written (default: results)",
    )
    group.add_argument(
        "--quiet",
        action="store_true",
        default=argparse.SUPPRESS,
        help="no progress bar, no table: errors only",
    )
    group.add_argument(
        "--no-cache",
        dest="cache",
        action="store_false",
        default=argparse.SUPPRESS,
        help="compile everything anew, and keep nothing of it for the next command",
    )


def _parse(argv: Sequence[str]) -> tuple[str, argparse.Namespace]:
    """The command's name, and its options with those that stood before it."""
    top = _top_parser()
    before = top.parse_args(argv)
    if before.command not in COMMANDS:
        near = did_you_mean(before.command, COMMANDS)
        top.error(f"unknown command {before.command!r}{near}: {listed(COMMANDS)}")
    parser = Parser(prog=f"softjax {before.command}", allow_abbrev=False)
    command = _command(before.command)
    parser.description = command.__doc__
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    command.add_arguments(parser)
    common_options(parser)
    own = vars(parser.parse_args(before.rest))
    given = {key: value for key, value in vars(before).items() if key in COMMON}
    return before.command, argparse.Namespace(**(COMMON | given | own))


def _top_parser() -> Parser:
    width = max(map(len, COMMANDS)) + 2
    lines = [f"  {name:<{width}}{what}" for name, what in COMMANDS.items()]
    parser = Parser(
        prog="softjax",
        allow_abbrev=False,
        usage="softjax COMMAND [options]",
        description="Soft-sphere collisions after Zhou (2013), calibrated from rebounds.",
        epilog="\n".join(["commands:", *lines, "", "softjax COMMAND --help tells the options."]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("command", metavar="COMMAND", help=argparse.SUPPRESS)
    parser.add_argument("rest", nargs=argparse.REMAINDER, help=argparse.SUPPRESS)
    parser.add_argument("--version", action=Version, nargs=0, help="print the version")
    common_options(parser)
    return parser


def _command(name: str):
    return importlib.import_module(f"calibration.commands.{name}")


def _refuse(line: str) -> int:
    print(" ".join(line.split()), file=sys.stderr)
    return UNUSABLE


def _never_fail_to_print() -> None:
    """A terminal that has no χ shows a question mark instead of a traceback."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
