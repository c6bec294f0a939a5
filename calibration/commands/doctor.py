"""Versions, devices, settings and a self-check, for reports of faults.

    softjax doctor
    softjax doctor --schema DIR      # the JSON Schemas of material files and of fit.json, and no check

The self-check compares one impact on steel with 40-digit arithmetic: by the energy balance, its
slopes, and by time integration. Exit code 1 where it fails.
"""

import argparse
import json
import platform
import sys
import time
from functools import partial
from importlib import metadata
from pathlib import Path

PACKAGES = (
    *("softjax-contact", "jax", "jaxlib", "diffrax", "equinox", "optax", "optimistix"),
    *("numpy", "scipy", "matplotlib", "rich"),
)
LARGEST = {"energy balance": 1e-13, "its slopes": 1e-9, "time integration": 1e-8}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    text = "write the JSON Schemas of material files and of fit.json into a folder instead"
    parser.add_argument("--schema", metavar="DIR", type=Path, help=text)


def run(arguments: argparse.Namespace) -> int:
    """Print, and check; 0, or 1 where a check failed."""
    if arguments.schema is not None:
        write_schemas(arguments.schema)
        return 0
    start = time.perf_counter()
    errors = self_check()
    passed = all(errors[name] <= limit for name, limit in LARGEST.items())
    if not arguments.quiet:
        limits = {n: f"error {errors[n]:.0e}, at most {limit:.0e}" for n, limit in LARGEST.items()}
        for name, value in {**_surroundings(arguments.cache), **limits}.items():
            print(f"{name + ':':<18} {value}")
        verdict = "passed" if passed else "FAILED"
        print(f"self-check {verdict} in {time.perf_counter() - start:.1f} s")
    elif not passed:
        print("softjax doctor: the self-check failed", file=sys.stderr)
    return 0 if passed else 1


def write_schemas(directory: Path) -> None:
    """The JSON Schemas of the files that are read and written."""
    from pydantic import BaseModel

    from calibration.data.material_tables import MaterialTables
    from calibration.fitting.fit_json import ResultFile
    from calibration.output import files_into, write_text

    models: dict[str, type[BaseModel]] = {"material_file": MaterialTables, "fit": ResultFile}
    with files_into(directory) as staged:
        for name, model in models.items():
            text = json.dumps(model.model_json_schema(), indent=1, ensure_ascii=False)
            write_text(staged / f"{name}.schema.json", text + "\n")


def _surroundings(with_cache: bool) -> dict[str, str]:
    """Versions, machine and settings, as text."""
    import jax

    versions = {name: metadata.version(name) for name in PACKAGES}
    devices = ", ".join(f"{d.platform}:{d.id} {d.device_kind}" for d in jax.devices())
    cache_folder = jax.config.jax_compilation_cache_dir if with_cache else None
    return versions | {
        "Python": f"{platform.python_version()} ({sys.executable})",
        "system": f"{platform.system()} {platform.release()}, {platform.machine()}",
        "devices": devices,
        "float64": "on" if jax.config.jax_enable_x64 else "off",
        "compiled programs": f"stored in {cache_folder}" if cache_folder else "not stored",
    }


def self_check() -> dict[str, float]:
    """Largest relative errors of ε_p and of its slopes against 40-digit arithmetic."""
    import jax
    import numpy as np

    import softjax as sj
    from calibration.speed import stainless_steel

    sj.enable_x64()
    scene = stainless_steel()
    few = slice(None, None, max(1, len(scene.exact) // 4))
    velocity, exact = scene.velocity[few], scene.exact[few]

    def coefficient(theta, route):
        return sj.restitution(scene.law_of(*theta), velocity, route=route).plastic_coefficient

    theta, balance = np.array(scene.theta), sj.EnergyBalance()
    slopes = jax.jit(jax.jacfwd(partial(coefficient, route=balance)))(theta).T
    steepness = theta[:, None] * slopes  # θ ∂ε_p/∂θ
    by_time = coefficient(theta, sj.ODE(rtol=1e-10))
    return {
        "energy balance": float(np.max(np.abs(coefficient(theta, balance) / exact - 1))),
        "its slopes": float(np.max(np.abs(steepness / scene.slopes[:, few] - 1))),
        "time integration": float(np.max(np.abs(by_time / exact - 1))),
    }
