"""What JAX compiled for one command serves the next: its compilation cache, in the user's own folder.

One folder for each version and each kind of processor, so that a home shared by the machines of a
cluster never hands one of them another's code.
"""

import hashlib
import importlib.metadata
import os
import platform
import sys
import warnings
from contextlib import suppress
from pathlib import Path

NAME = "softjax"
LARGEST = 256 * 1024**2  # bytes; beyond, what was used longest ago goes
ENTRIES = "*-cache"  # JAX's files; nothing else is removed
PACKAGES = ("softjax-contact", "jax", "jaxlib", "diffrax", "equinox")

_kept: Path | None = None  # the folder, while compilations are kept


def keep_compilations() -> Path | None:
    """Let JAX keep what it compiles; where, or None where the user has said so already or nothing can be written."""
    global _kept
    if os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        return None
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    if not os.access(folder, os.W_OK):
        return None
    _make_room(folder.parent)
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache")
    import jax

    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    _kept = folder
    return folder


def forget_since(moment: float) -> None:
    """Remove what was kept since then [s]: it may be cut short, and JAX would not write it again."""
    with suppress(OSError):
        for file in () if _kept is None else _kept.glob(ENTRIES):
            if file.stat().st_mtime >= moment:
                file.unlink(missing_ok=True)


def cache_folder() -> Path:
    """The folder of this version on this kind of processor."""
    versions = [f"{name} {importlib.metadata.version(name)}" for name in PACKAGES]
    kind = "\n".join([*versions, sys.version, platform.machine(), _processor()])
    return _home() / NAME / hashlib.sha256(kind.encode()).hexdigest()[:16]


def _make_room(folder: Path) -> None:
    """Remove what was used longest ago, of this version or another, until the rest is small enough."""
    try:
        files = [(f.stat(), f) for f in folder.glob(f"*/{ENTRIES}") if f.is_file()]
        total = sum(stat.st_size for stat, _ in files)
        for stat, file in sorted(files, key=lambda one: one[0].st_atime):
            if total <= LARGEST:
                return
            file.unlink(missing_ok=True)
            total -= stat.st_size
    except OSError:
        return  # another command may be at it


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
