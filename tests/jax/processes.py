"""A process of its own, where JAX starts anew: several devices, threads, other settings."""

import os
import subprocess
import sys
import textwrap
from pathlib import Path

ROOT = Path(__file__).parents[2]
START = """
import os
os.environ["XLA_FLAGS"] = "--xla_force_host_platform_device_count={devices}"
os.environ["JAX_PLATFORMS"] = "cpu"
import jax, jax.numpy as jnp, numpy as np
import softjax as sj
sj.enable_x64()
pair = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, 0.0127, 0.0127)
velocity = np.array([0.1, 0.2, 1.0, 2.0])
"""


def run(code: str, devices: int = 2) -> str:
    """What it prints; it must end well and without a warning."""
    whole = START.format(devices=devices) + textwrap.dedent(code)
    command = [sys.executable, "-W", "error", "-c", whole]
    known = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=known)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout
