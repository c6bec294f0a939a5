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
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def both(code: str) -> list[subprocess.CompletedProcess]:
    """Both processes, once they have ended."""
    env = os.environ | {"JAX_PLATFORMS": "cpu"}
    started = [
        subprocess.Popen(
            [sys.executable, "-c", code, str(k)],
            cwd=ROOT,
            env=env,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for k in (0, 1)
    ]
    try:
        written = [one.communicate(timeout=240) for one in started]
    finally:
        for one in started:
            one.kill()
    return [
        subprocess.CompletedProcess(one.args, one.returncode, *text)
        for one, text in zip(started, written, strict=True)
    ]


def test_each_process_has_its_half_and_the_slope_of_both():
    """The halves are those of one process; the slope is the sum over all impacts."""
    for _ in range(TRIES):
        ended = both(script().replace(ADDRESS, f"localhost:{free_port()}"))
        if not any("ddress already in use" in one.stderr for one in ended):
            break
    assert [one.returncode for one in ended] == [0, 0], [one.stderr[-1500:] for one in ended]
    pair = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, 0.0127, 0.0127)
    law = sj.Zhou(pair, chi=0.22, sigma=0.4355, psi=0.5414)
    velocity = np.concatenate([np.linspace(1.0, 25.0, 50_000) + 25.0 * k for k in (0, 1)])
    step = 1e-4  # central differences, not autodiff
    low, high = (
        float(np.sum(sj.restitution(sj.Zhou(pair, chi, 0.4355, 0.5414), velocity).coefficient))
        for chi in (0.22 - step, 0.22 + step)
    )
    slope = (high - low) / (2 * step)
    for k, one in enumerate(ended):
        said = re.search(r"(\d) \((\d+),\) (\S+) (\S+)$", one.stdout.strip())
        assert said, one.stdout
        index, count, first, found = said.groups()
        assert (int(index), int(count)) == (k, 50_000)
        expected = float(sj.restitution(law, 1.0 + 25.0 * k).coefficient)
        assert float(first) == pytest.approx(expected, rel=1e-12)
        assert float(found) == pytest.approx(slope, rel=1e-6)
