"""Cost of an atom and a step in LAMMPS, exported laws beside LAMMPS' own: `python -m tests.benchmarks.lammps_cost`.

Processor time of a gas of 4096 steel spheres in one process, each law in turn, five times over. Needs `softjax-contact[export-test]`.
"""

import re
import subprocess
import tempfile
from pathlib import Path

import numpy as np

import calibration as cal
import softjax as sj
from tests.cases import RADIUS
from tests.export.lammps import ENVIRONMENT, MOVES, NEEDED, SPHERES, build
from tests.export.laws import DENSITY, RANGE, STEEL

SIDE, STEPS, REPEATS = 16, 2000, 5
STYLES = {
    "softjax, Zhou's law": ("softjax", "softjax"),
    "granular hertz, coeff_restitution": ("granular", None),  # as it is exported
    "granular hooke, viscous damping": ("granular", "hooke 1e7 50 tangential linear_nohistory 0 0"),
}


def gas(style: str, coefficients: str) -> list[str]:
    return [
        "clear",
        *SPHERES,
        "boundary p p p",
        "newton off",
        "comm_modify vel yes",
        "lattice sc 0.0270",
        f"region box block 0 {SIDE} 0 {SIDE} 0 {SIDE}",
        "create_box 1 box",
        "create_atoms 1 box",
        f"set group all diameter {2 * RADIUS} density {DENSITY}",
        "velocity all create 1.0 12345 dist uniform rot no",
        "velocity all scale 5.0e21",
        f"pair_style {style}",
        f"pair_coeff * * {coefficients}",
        *MOVES,
        "timestep 1e-6",
        "neighbor 2e-3 bin",
        f"run {STEPS}",
    ]


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        options = {"velocity_range": RANGE, "tolerance": 0.08}
        cal.export(STEEL, "lammps", folder, law="hertz-dashpot", **options)
        text = (folder / "in.softjax").read_text(encoding="utf-8")
        (own,) = (line for line in text.splitlines() if line.startswith("pair_coeff"))
        cal.export(STEEL, "lammps", folder, law="exact", **options)
        build(folder)
        laws = [(s, c or own.removeprefix("pair_coeff * * ")) for s, c in STYLES.values()]
        lines = [line for _ in range(REPEATS) for style in laws for line in gas(*style)]
        (folder / "in.cost").write_text(
            "\n".join(["plugin load ./softjaxplugin.so", *lines]), "utf-8"
        )
        command = [NEEDED[2], "-in", "in.cost", "-log", "none"]
        ended = subprocess.run(command, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stdout[-1000:]
    loops = re.findall(r"^Loop time of (\S+) ", ended.stdout, re.M)
    shares = re.findall(r"^(\S+)% CPU use", ended.stdout, re.M)
    seconds = np.array(loops, float) * np.array(shares, float) / 100  # of the processor
    each = 1e9 * seconds.reshape(REPEATS, -1) / (SIDE**3 * STEPS)
    for label, costs in zip(STYLES, each.T, strict=True):
        print(f"{label:40} {np.median(costs):6.1f} ns, {np.min(costs):.1f} to {np.max(costs):.1f}")


if __name__ == "__main__":
    sj.enable_x64()
    main()
