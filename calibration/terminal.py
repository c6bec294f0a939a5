"""Terminals as they are: without Greek letters, narrow, closed, full."""

import codecs
import io
import os
import shlex
import shutil
import sys
import textwrap
import unicodedata
from collections.abc import Iterable
from contextlib import suppress
from typing import TextIO

LETTERS = """
α alpha β beta γ gamma δ delta ε eps ζ zeta η eta θ theta ϑ theta κ kappa λ lambda µ u μ mu ν nu
ξ xi π pi ρ rho σ sigma τ tau φ phi χ chi ψ psi ω omega Γ Gamma Δ Delta Σ Sum Ω Omega ℓ l
⁰ ^0 ¹ ^1 ² ^2 ³ ^3 ⁴ ^4 ⁵ ^5 ⁶ ^6 ⁷ ^7 ⁸ ^8 ⁹ ^9 ⁺ ^+ ⁻ ^- ᵀ ^T ± +/- √ sqrt ∂ d ∫ int ∞ inf
∕ / ∝ ~ ≈ ~ ≤ <= ≥ >= → -> ← <- × x · * ⋅ * − - – - — - … ... ′ ' ° deg ½ 1/2 ─ - │ | ├ | └ |
"""
PLAIN = dict(zip(LETTERS.split()[::2], LETTERS.split()[1::2], strict=True))
PLAIN["\N{COMBINING TILDE}"] = ""  # of χ̃: there is no other chi
NAME = "softjax.plain"
WIDTH = 100  # of running text, on wider terminals too


def prepare() -> None:
    """Make the three standard streams such that nothing fails for want of a letter, or of a stream.

    A stream that was closed (`2>&-`) is the null device from here on: else a file of results would
    become it. To write to a closed standard output stays an error, as something was asked for.
    """
    codecs.register_error(NAME, _plain_letters)
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            _fill(number)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=NAME)


def first_lines(lines: Iterable[str], quiet: bool) -> None:
    """What is told before anything else; of a quiet command on standard error."""
    for line in lines:
        print(line, file=sys.stderr if quiet else sys.stdout, flush=True)


def letters(text: str) -> str:
    """The text in letters that standard output has: χ̃ as it is, or `chi`."""
    encoding = getattr(sys.stdout, "encoding", None)
    return text.encode(encoding, NAME).decode(encoding) if encoding else text


def columns() -> int | None:
    """How wide the terminal is; None where standard output is none, and lines may be long."""
    if sys.stdout is None or not sys.stdout.isatty():
        return None
    return shutil.get_terminal_size((WIDTH, 24)).columns


def width() -> int:
    """To which running text is broken into lines."""
    return max(20, min(WIDTH, columns() or WIDTH))


def wrapped(paragraphs: Iterable[str], first: str = "", rest: str = "") -> list[str]:
    """Paragraphs as lines, the first of each and the rest behind some margin."""
    wrapper = textwrap.TextWrapper(width(), initial_indent=first, subsequent_indent=rest)
    return [line for text in paragraphs for line in wrapper.wrap(text)]


def cannot_go_back() -> bool:
    """Whether what was shown on a line of the terminal stays there."""
    return os.environ.get("TERM") == "dumb"


def shell_line(words: Iterable[str]) -> str:
    """Words as a shell reads them; one with bytes that are no text, or control characters, as $'…'."""
    return " ".join(
        shlex.quote(word) if word.isprintable() else f"$'{_in_bytes(word)}'" for word in words
    )


def silence(stream: TextIO | None) -> None:
    """Send to nowhere what a stream that failed still holds."""
    with suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())  # type: ignore[union-attr]
        os.close(nowhere)


def _fill(number: int) -> None:
    """Open the null device where a standard stream was closed."""
    name = ("stdin", "stdout", "stderr")[number]
    opened = os.open(os.devnull, os.O_WRONLY if number == 2 else os.O_RDONLY)
    if opened != number:
        os.dup2(opened, number)
        os.close(opened)
    if getattr(sys, name) is None:
        mode = "w" if number else "r"
        setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115


def _in_bytes(word: str) -> str:
    plain = set(b"%+,-./0123456789:=@_abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ")
    raw = word.encode("utf-8", "surrogateescape")
    return "".join(chr(byte) if byte in plain else f"\\x{byte:02x}" for byte in raw)


def _plain_letters(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = "".join(map(_plain, error.object[error.start : error.end]))
    return text.replace("^-^", "^-"), error.end


def _plain(letter: str) -> str:
    """One letter in ASCII: its word, else without its accent, else its code."""
    bare = unicodedata.normalize("NFKD", letter).encode("ascii", "ignore").decode()
    return PLAIN.get(letter, bare or letter.encode("unicode_escape").decode())
