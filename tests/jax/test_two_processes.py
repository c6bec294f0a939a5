"""Two processes with half of an array each: the script of the reference as it stands there."""

import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import softjax as sj

ROOT = Path(__file__).parents[2]
ADDRESS = "localhost:12345"
TRIES = 3  # another program may take a free port before JAX does


def script() -> str:
    page = (ROOT / "notebooks" / "reference" / "devices.md").read_text(encoding="utf-8")
    (found,) = re.findall(r"```py\n(.*?)```", page, re.S)
    assert found.count(ADDRESS) == 1
    return found


def free_port() -> int:
    with socket.socket() as connection:
        connection.bind(("127.0.0.1", 0))
        return connection.getsockname()[1]


def both(code: str) -> list[tuple[int | None, str, str]]:
    """What both processes return and write, once they have ended."""
    given = {"cwd": ROOT, "env": os.environ | {"JAX_PLATFORMS": "cpu"}, "text": True}
    given |= {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    started = [subprocess.Popen([sys.executable, "-c", code, k], **given) for k in "01"]
    try:
        written = [process.communicate(timeout=240) for process in started]
    finally:
        for process in started:
            process.kill()
    return [(process.returncode, *text) for process, text in zip(started, written, strict=True)]


def test_each_process_has_its_half_and_the_slope_of_both():
    """ε is Thornton's formula; the slope is the sum over all impacts."""
    for _ in range(TRIES):
        ended = both(script().replace(ADDRESS, f"localhost:{free_port()}"))
        if not any("ddress already in use" in error for _, _, error in ended):
            break
    assert [code for code, *_ in ended] == [0, 0], [error[-1500:] for *_, error in ended]
    pair = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, 0.0127, 0.0127)
    velocity = np.concatenate([np.linspace(1.0, 25.0, 50_000) + 25.0 * k for k in (0, 1)])

    def restitution(factor):
        r = float(sj.Thornton(pair, factor).elastic_velocity()) / velocity
        root = np.sqrt(1.2 - 0.2 * r * r)
        return 3**0.25 * root * (r / (r + 2 * root)) ** 0.25

    step = 1e-4  # central differences, not autodiff
    low, alone, high = (restitution(1.6 + side * step) for side in (-1, 0, 1))
    slope = (np.sum(high) - np.sum(low)) / (2 * step)
    for k, (_, out, _) in enumerate(ended):
        match = re.search(r"(\d) \((\d+),\) (\S+) (\S+)$", out.strip())
        assert match, out
        index, count, first, found = match.groups()
        assert (int(index), int(count)) == (k, 50_000)
        assert float(first) == pytest.approx(alone[50_000 * k], rel=1e-12)
        assert float(found) == pytest.approx(slope, rel=1e-6)
