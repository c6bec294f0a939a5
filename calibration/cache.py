"""Compiled programs of one command serve the next: JAX's own cache, bounded, in the user's folder.

One folder for each version and each kind of processor, so that a home shared by the machines of a
cluster never hands one of them another's code.

JAX's bounded cache locks the folder while it reads or writes, and notes the time of use of an entry in
a file of its own when the entry is whole. It writes in place and never renews an entry: one cut short by a
kill or a full disk, which has no such note, is removed by the next command; one that cannot be read makes
the command that found it remove all.
"""

import hashlib
import importlib.metadata
import os
import platform
import re
import shutil
import sys
import time
import warnings
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

NAME = "softjax"
LARGEST = 256 * 1024**2  # bytes; beyond, JAX removes what was used longest ago
UNUSED = 60 * 86_400  # seconds after which the folder of another version or processor goes
PACKAGES = ("softjax-contact", "jax", "jaxlib", "diffrax", "equinox")
# of the decompressors that JAX may use
TORN = re.compile(r"Error reading persistent.*: (error|ZstdError|EOFError): ", re.DOTALL)

_kept: Path | None = None  # the folder, while compilations are kept
_torn = False  # whether an entry of it could not be read


def keep_compilations() -> Path | None:
    """Let JAX keep what it compiles; where, or None where the user has set a place or nothing can be written."""
    global _kept
    if os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        return None
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)  # used now
    except OSError:
        return None
    if not os.access(folder, os.W_OK):
        return None
    _remove_unused(folder)
    if _kept is None:
        _listen()
    import jax

    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_compilation_cache_max_size", LARGEST)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    _kept = folder
    return folder


def remove_torn() -> None:
    """Empty the folder if an entry of it could not be read: JAX would not write it again."""
    global _torn
    if _torn and _kept is not None:
        _remove(_kept.glob("*-cache"))
    _torn = False


def cache_folder() -> Path:
    """The folder of this version on this kind of processor."""
    versions = [f"{name} {importlib.metadata.version(name)}" for name in PACKAGES]
    kind = "\n".join([*versions, sys.version, platform.machine(), _processor()])
    return _home() / NAME / hashlib.sha256(kind.encode()).hexdigest()[:16]


def _remove_unused(folder: Path) -> None:
    """Remove entries that were cut short, and folders that nobody has used for long."""
    with suppress(OSError):
        _remove(one for one in folder.glob("*-cache") if not _noted(one).exists())
        for other in folder.parent.iterdir():
            ours = re.fullmatch("[0-9a-f]{16}", other.name) and other.is_dir()
            if ours and other.stat().st_mtime < time.time() - UNUSED:
                shutil.rmtree(other, ignore_errors=True)


def _remove(entries: Iterable[Path]) -> None:
    with suppress(OSError):  # another command may be at it
        for entry in entries:
            entry.unlink(missing_ok=True)
            _noted(entry).unlink(missing_ok=True)


def _noted(entry: Path) -> Path:
    """Where JAX notes when an entry was used."""
    return entry.with_name(entry.name.removesuffix("-cache") + "-atime")


def _listen() -> None:
    """Take JAX's warnings about its cache, which are no matter of the user's."""
    show = warnings.showwarning

    def heard(message, *where, **more):
        global _torn
        if "persistent compilation cache" not in str(message):
            return show(message, *where, **more)
        _torn = _torn or TORN.match(str(message)) is not None

    warnings.filterwarnings("always", "Error (reading|writing) persistent compilation cache")
    warnings.showwarning = heard


def _home() -> Path:
    """Where the system keeps what can be made again."""
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def _processor() -> str:
    """Model and abilities of the processor: what compiled code depends on."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return platform.processor()
    lines = text.partition("\n\n")[0].splitlines()
    kept = ("model name", "flags", "Features", "CPU part", "CPU implementer")
    return "\n".join(line for line in lines if line.startswith(kept))
