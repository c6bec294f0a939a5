"""The command `softjax`: finds the subcommand, tells refusals in one line, gives the exit code.

    0   done
    1   a fit did not converge; its results are written, and marked
    2   unusable input: one line on standard error, nothing written
    3   results could not be written, or not told; what could be is
    70  an error of softjax itself: its trace on standard error

An interrupt gives 130, SIGTERM 143, SIGHUP 129.
Nothing heavy is imported before a subcommand runs, so that `softjax --help` answers at once.
"""

import argparse
import errno
import importlib
import logging
import os
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from calibration import atomic, progress, signals, terminal
from calibration.cache import keep_compilations, remove_torn
from calibration.commands import COMMANDS
from calibration.errors import DataError, InputError, NotWritten, did_you_mean, listed, printable

DONE, NOT_CONVERGED, UNUSABLE, NOT_WRITTEN, INTERNAL, INTERRUPTED = 0, 1, 2, 3, 70, 130
# of a stream that is closed, or full
STREAM = {errno.EBADF, errno.EIO, errno.EFBIG, errno.ENOSPC, errno.EDQUOT}
COMMON = {"out": Path("results"), "quiet": False, "cache": True}
CODES = """exit codes:
  0  done
  1  a fit did not converge; its results are written, and marked
  2  input that cannot be used; nothing is written
  3  results could not be written: no space, no permission, no such place
  70 an error of softjax itself, with its trace: please report it"""


class Parser(argparse.ArgumentParser):
    """Says in one line what is wrong, without the whole usage before it."""

    def error(self, message: str):
        line = " ".join(message.split())
        self.exit(UNUSABLE, f"{self.prog}: {line}; {self.prog} --help lists what is accepted\n")

    def print_help(self, file=None) -> None:
        print(self.format_help(), end="", file=file or sys.stdout)  # argparse's own hides failures


class Version(argparse.Action):
    """Looks the version up when it is asked for: it is in a file of the installed distribution."""

    def __call__(self, parser, *_):
        from importlib.metadata import version

        print(f"softjax-contact {version('softjax-contact')}")
        parser.exit(DONE)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line; returns the exit code."""
    terminal.prepare()
    atomic.written.clear()
    try:
        with signals.heard():
            return _run(sys.argv[1:] if argv is None else argv)
    except (InputError, DataError) as error:
        return _tell(str(error), UNUSABLE)
    except KeyboardInterrupt as stop:
        return _tell(f"softjax: {_left_behind()}", getattr(stop, "code", INTERRUPTED))
    except BrokenPipeError:  # `softjax fit | head`
        terminal.silence(sys.stdout)
        return DONE
    except Exception as error:
        return _failed(error)
    finally:
        remove_torn()
        progress.erase_sign()


def _run(argv: Sequence[str]) -> int:
    try:
        name, arguments = _parse(argv)
        progress.first_sign(f"softjax {name}: loading", arguments.quiet)
        # a fit's matrices are small: threads of the linear algebra would wait for each other
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        logging.getLogger("matplotlib.font_manager").setLevel(logging.ERROR)  # of its own cache
        if arguments.cache:
            keep_compilations()
        code = _command(name).run(arguments)
        if not arguments.quiet:
            _name_older(name, arguments.out)
        return code
    finally:
        if sys.stdout is not None:  # what a buffer holds is not told yet
            sys.stdout.flush()


def _name_older(command: str, out: Path) -> None:
    """One line for files among the results that this run did not write, one for unfinished ones."""
    lines = [
        f"not written by this run, in {place}: {', '.join(names)}"
        for place, names in atomic.written.items()
        if names
    ]
    left = atomic.unfinished(out) if atomic.written else []
    if left:
        lines.append(f"of a command that was killed, or is still at work: {', '.join(left)}")
    for line in lines:
        print(printable(f"softjax {command}: {line}"), file=sys.stderr)


def _failed(error: Exception) -> int:
    """What cannot be written, and what is refused, in a line; any other error with its trace."""
    if isinstance(error, NotWritten):
        terminal.silence(sys.stdout)
        return _tell(f"softjax: {error}", NOT_WRITTEN)
    if isinstance(error, OSError) and error.filename is None and error.errno in STREAM:
        terminal.silence(sys.stdout)
        return _tell(
            f"softjax: standard output could not be written to ({error.strerror})", NOT_WRITTEN
        )
    if "softjax" in sys.modules and isinstance(error, sys.modules["softjax"].ArgumentError):
        return _tell(str(error), UNUSABLE)
    progress.erase_sign()
    with suppress(OSError):
        traceback.print_exception(error)
    return _tell(
        "softjax: an error of softjax itself, please report it with the lines above", INTERNAL
    )


def _left_behind() -> str:
    """What a command that was stopped has done."""
    places = sorted(printable(str(place)) for place in atomic.written if place.exists())
    if not places:
        return "interrupted, nothing written"
    return f"interrupted after its results were written to {listed(places)}"


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
    parser.epilog = CODES
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
        epilog="\n".join(
            ["commands:", *lines, "", CODES, "", "softjax COMMAND --help tells the options."]
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("command", metavar="COMMAND", help=argparse.SUPPRESS)
    parser.add_argument("rest", nargs=argparse.REMAINDER, help=argparse.SUPPRESS)
    parser.add_argument("--version", action=Version, nargs=0, help="print the version")
    common_options(parser)
    return parser


def _command(name: str):
    return importlib.import_module(f"calibration.commands.{name}")


def _tell(line: str, code: int) -> int:
    """One line on standard error, where there is one."""
    progress.erase_sign()
    with suppress(OSError):
        print(printable(" ".join(line.split())), file=sys.stderr, flush=True)
    return code
