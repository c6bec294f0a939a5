"""The command `softjax`: finds the subcommand, prints refusals in one line, gives the exit code (`CODES`).

An interrupt gives 130, SIGTERM 143, SIGHUP 129. Nothing heavy is imported before a subcommand runs, so that
`softjax --help` answers at once.
"""

import argparse
import errno
import gc
import hashlib
import importlib
import logging
import os
import platform
import re
import shlex
import sys
import traceback
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from calibration import console, output
from calibration.commands import COMMANDS
from calibration.errors import DataError, InputError, NotWritten, did_you_mean, listed, printable

DONE, UNUSABLE, NOT_WRITTEN, INTERNAL, INTERRUPTED = 0, 2, 3, 70, 130
# of a stream that is closed, or full
STREAM = {errno.EBADF, errno.EIO, errno.EFBIG, errno.ENOSPC, errno.EDQUOT}
CACHE_SIZE = 256 * 1024**2  # bytes; beyond, JAX removes what was used longest ago
# options by the arguments of functions that they become
OPTIONS = {"velocity_range": "range", "count": "shots", "result_or_law": "law"}
CODES = """exit codes:
  0  done
  1  a fit did not converge; its results are written, and marked
  2  input that cannot be used; nothing is written
  3  results could not be written: no space, no permission, no such place; or a picture failed
  70 an error of softjax itself, with its trace: please report it"""


class Parser(argparse.ArgumentParser):
    """Report in one line what is wrong and the nearest option, without the usage text."""

    def error(self, message: str):
        line, near = " ".join(message.split()), ""
        if unknown := re.search(r"unrecognized arguments: (--[\w-]+)", line):
            near = did_you_mean(unknown[1], self._option_string_actions)
        elif choice := re.search(r"invalid choice: '(.*?)' \(choose from (.*)\)", line):
            near = did_you_mean(choice[1], re.findall(r"[\w-]+", choice[2]))
        accepted = f"{self.prog} --help lists what is accepted"
        self.exit(UNUSABLE, printable(f"{self.prog}: {line}{near}; {accepted}") + "\n")

    def print_help(self, file=None) -> None:
        print(self.format_help(), end="", file=file or sys.stdout)  # argparse's own hides failures


class Version(argparse.Action):
    """Look the version up in the installed distribution."""

    def __call__(self, parser, *_):
        from importlib.metadata import version

        print(f"softjax-contact {version('softjax-contact')}")
        parser.exit(DONE)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line; returns the exit code."""
    console.open_streams()
    output.written.clear()
    output.lost.clear()
    stops: list[console.Stopped] = []
    try:
        with console.signals_handled() as stops:
            code = _run(sys.argv[1:] if argv is None else list(argv))
        if stops:  # swallowed at the very end
            raise stops[0]
        return code
    except BrokenPipeError:  # `softjax fit | head`
        console.silence(sys.stdout)
        return DONE
    except (Exception, KeyboardInterrupt) as error:
        text, code = _outcome(next(iter(stops), error))
        with suppress(OSError):
            for line in text.splitlines():  # each fault of a file
                print(printable(" ".join(line.split())), file=sys.stderr)
        return code


def _outcome(error: BaseException) -> tuple[str, int]:
    """The message and the exit code of an error; prints its trace if it is not a refusal."""
    softjax = sys.modules.get("softjax")  # not imported for this
    refusals = (InputError, DataError, *([softjax.ArgumentError] if softjax else []))
    if isinstance(error, refusals):
        return str(error), UNUSABLE
    if isinstance(error, KeyboardInterrupt):
        done = f" after its results were written to {listed(sorted(map(str, output.written)))}"
        words = done if output.written else ", nothing written"
        return f"softjax: interrupted{words}", getattr(error, "code", INTERRUPTED)
    of_stream = isinstance(error, OSError) and error.filename is None and error.errno in STREAM
    if of_stream or isinstance(error, NotWritten):
        console.silence(sys.stdout)
        words = f"standard output could not be written to ({getattr(error, 'strerror', '')})"
        return f"softjax: {error if isinstance(error, NotWritten) else words}", NOT_WRITTEN
    with suppress(OSError):
        traceback.print_exception(error)
    return "softjax: an error of softjax itself, please report it with the lines above", INTERNAL


def _run(argv: Sequence[str]) -> int:
    try:
        name, command, arguments = _parsed(argv)
        if not arguments.quiet and console.is_terminal():  # what follows may take seconds
            print(f"softjax {name}: loading ...", file=sys.stderr)
        # modules and programs stay: looking through them takes a tenth
        gc.set_threshold(100_000, 20, 20)
        logging.getLogger("matplotlib").setLevel(logging.ERROR)  # words on its own cache
        if arguments.cache:
            keep_compilations()
        try:
            code = command.run(arguments)
        except DataError as error:
            error.argument = _option_of(error.argument, arguments)
            raise
        for place, (new, older) in () if arguments.quiet else output.written.items():
            if not getattr(arguments, "json", False):
                print(f"Written to {place}: {listed(new)}")
            if older:
                line = f"softjax {name}: not written by this run, in {place}: {listed(older)}"
                print(printable(line), file=sys.stderr)
        for picture, reason in output.lost.items():
            line = f"softjax {name}: {picture} could not be drawn ({reason}); the rest is written"
            print(printable(line), file=sys.stderr)
        return NOT_WRITTEN if output.lost else code
    finally:
        if sys.stdout is not None:  # what a buffer holds is not printed yet
            sys.stdout.flush()


def _option_of(argument: str, arguments: argparse.Namespace) -> str:
    """The option that became an argument of a function, else the argument."""
    name, own = argument.partition("[")[0], hasattr(arguments, "export_law")
    if name == "velocity" and hasattr(arguments, "first"):
        return "--from, --to"
    name = "export_law" if name == "law" and own else OPTIONS.get(name, name)
    is_stated = getattr(arguments, name, None) not in (None, [])
    return f"--{name.replace('_', '-')}" if is_stated else argument


def _parsed(argv: Sequence[str]) -> tuple[str, Any, argparse.Namespace]:
    """The command's name, its module, and its options, also those that stand before its name."""
    words = (k for k, w in enumerate(argv) if w[:1] != "-" and argv[k - 1 : k] != ["--out"])
    at = next(words, len(argv))
    name = "".join(argv[at : at + 1])
    if name not in COMMANDS:
        width = max(map(len, COMMANDS))
        lines = ["commands:", *(f"  {name:<{width}}  {what}" for name, what in COMMANDS.items())]
        lines += ["", CODES, "", "softjax COMMAND --help lists the options."]
        what = "Soft-sphere collisions after Zhou (2013), calibrated from rebounds."
        top = _parser("softjax", what, "\n".join(lines), usage="softjax COMMAND [options]")
        keywords: dict[str, Any] = {"choices": COMMANDS, "help": argparse.SUPPRESS}
        top.add_argument("command", metavar="COMMAND", nargs="?", **keywords)
        top.add_argument("--version", action=Version, nargs=0, help="print the version")
        if not argv:
            top.print_help()
            top.exit(DONE)
        top.parse_args(argv)  # prints help or the version, or refuses
        top.error("COMMAND is missing")
    command = importlib.import_module(f"calibration.commands.{name}")
    parser = _parser(f"softjax {name}", command.__doc__, CODES, command.add_arguments)
    arguments = parser.parse_args([*argv[:at], *argv[at + 1 :]])
    arguments.as_typed = printable(shlex.join(["softjax", *argv]))
    return name, command, arguments


def _parser(
    name: str,
    what: str | None,
    epilog: str,
    add: Callable[[Parser], None] | None = None,
    usage: str | None = None,
) -> Parser:
    """A parser with the options of a command, and those of all: `--out`, `--quiet` and `--no-cache`."""
    keywords: dict[str, Any] = {"formatter_class": argparse.RawDescriptionHelpFormatter}
    parser = Parser(name, usage, what, epilog, allow_abbrev=False, **keywords)
    if add is not None:
        add(parser)
    group = parser.add_argument_group("common options")
    text = "where results are written (default: results)"
    group.add_argument("--out", type=Path, default=Path("results"), metavar="DIR", help=text)
    text = "no progress bar, no table: errors only"
    group.add_argument("--quiet", action="store_true", help=text)
    text = "compile everything again, and keep no compiled program for the next command"
    group.add_argument("--no-cache", dest="cache", action="store_false", help=text)
    return parser


def keep_compilations() -> None:
    """Let JAX keep what it compiles, in its own bounded cache in the user's folder.

    A folder for each kind of processor, as machines of a cluster share a home. Where the user has set a
    place, or no folder can be made, nothing changes.
    """
    if os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        return
    kind = platform.processor()
    with suppress(OSError):
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
        kind = str(sorted(set(re.findall(r"^(?:model name|flags|Features|CPU \w+).*", text, re.M))))
    try:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        folder = home / "softjax" / hashlib.sha256(kind.encode()).hexdigest()[:16]
        folder.mkdir(parents=True, exist_ok=True)
        for entry in folder.glob("*-cache"):  # JAX stops at one that a kill cut short
            if not entry.with_name(entry.name.removesuffix("cache") + "atime").exists():
                entry.unlink(missing_ok=True)
    except (OSError, RuntimeError):  # no room, no rights, no home
        return
    if not os.access(folder, os.W_OK):
        return
    import jax

    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_compilation_cache_max_size", CACHE_SIZE)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    # entries that cannot be read are compiled again, which is no matter of the user's
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache")
