"""A scene in LAMMPS from exported files alone: balls of two materials poured onto a plate of a third."""

import re

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import FITTED, MATERIALS
from tests.export.lammps import build, lammps, needs_lammps

pytestmark = [needs_lammps, pytest.mark.long, pytest.mark.codes]
BALLS = ("stainless steel", "nylon")  # types 1 and 2
PLATE = "chrome steel"
RADII = (0.005, 0.006)
COUNT, POURED, WIDE = 10_000, 11_000, 0.24  # spheres at least, and asked for; the plate [m]
HIGH = 1.2
SOME, LID, EACH = 180, 0.12, 4  # spheres and the height of the cloud [m], steps between frames
GRAVITY = 9.81


def law_of(first: str, second: str, *radii: float) -> sj.Zhou:
    """Zhou's law of two materials, with the χ̃ of the one that yields first."""
    bodies = [MATERIALS[name] for name in (first, second)]
    if len(radii) == 2:
        contact = sj.Contact.between_spheres(*bodies, *radii, area="zhou")
    else:
        contact = sj.Contact.with_wall(bodies[0], wall=bodies[1], radius=radii[0], area="zhou")
    softer = min((first, second), key=lambda name: float(MATERIALS[name].yield_strength))
    return sj.Zhou(contact, **FITTED[softer])


LAWS = {
    "one_one": law_of(BALLS[0], BALLS[0], RADII[0], RADII[0]),
    "one_two": law_of(*BALLS, *RADII),
    "two_two": law_of(BALLS[1], BALLS[1], RADII[1], RADII[1]),
    "one_plate": law_of(BALLS[0], PLATE, RADII[0]),
    "two_plate": law_of(BALLS[1], PLATE, RADII[1]),
}
TYPES = {"one_one": (1, 1), "one_two": (1, 2), "two_two": (2, 2)}


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """The exported files with their plugin, the input lines, and the time step."""
    folder = tmp_path_factory.mktemp("pour")
    lines, steps = [], []
    for name, law in LAWS.items():
        made = cal.export(
            law,
            "lammps",
            folder,
            velocity_range=(0.05, 5.0),
            law="exact",
            tolerance=0.01,
            overlap=0.1,
            radius=min(RADII),
            below="hold",
            prefix=name,
            types=TYPES.get(name),
            on_wall=name.endswith("plate"),
        )
        assert made.choice.total <= 0.01
        steps.append(made.time_step)
        if name in TYPES:
            lines.append(f"include in.{name}")
    build(folder)
    for kind, name in enumerate(("one", "two"), 1):
        lines += [f"group {name} type {kind}", f"fix floor_{name} {name} softjax/wall {name}_plate zplane 0 NULL"]  # fmt: skip
    return folder, [*lines, f"timestep {min(steps)!r}"], min(steps)


def box(high: float) -> list[str]:
    return [
        "units si",
        "atom_style sphere",
        "atom_modify map array",
        "boundary p p f",
        "newton off",
        f"region box block 0 {WIDE} 0 {WIDE} 0 {high}",
        "create_box 2 box",
    ]


ENERGY = [
    "compute moving all ke",
    f"variable height atom mass*{GRAVITY}*z",
    "compute lifted all reduce sum v_height",
    "thermo_style custom step atoms ke c_lifted",
    "thermo_modify norm no lost error",
]
BOOKED = (
    'print "RESULT $(atoms) $(ke:%.17g) $(c_lifted:%.17g) $(vcm(all,x)*mass(all):%.17g) '
    '$(vcm(all,y)*mass(all):%.17g)"'
)


def pour(scene, ranks: int, restart: bool) -> np.ndarray:
    """Atoms, kinetic energy, potential energy, and momentum along the plate, over the time after the pour."""
    folder, laws, step = scene
    poured, settled = int(0.3 / step), int(0.03 / step)
    density = [float(MATERIALS[name].density) for name in BALLS]
    start = [*box(HIGH), *laws, "fix move all nve/sphere"]
    start += [f"fix down all gravity {GRAVITY} vector 0 0 -1", "neighbor 1e-3 bin"]
    for kind in (1, 2):
        radius, rho = RADII[kind - 1], density[kind - 1]
        low = 0.2 + 0.5 * (kind - 1)
        start.append(f"region above{kind} block 0 {WIDE} 0 {WIDE} {low} {low + 0.48}")
        start.append(
            f"fix pour{kind} {('one', 'two')[kind - 1]} pour {POURED // 2} {kind} {4711 + kind} region above{kind} vol 0.25 500 "
            f"dens {rho} {rho} vel -.3 .3 -.3 .3 -1 diam one {2 * radius}"
        )
    start += [f"run {poured}", "unfix pour1", "unfix pour2", *ENERGY, "run 0", BOOKED]
    if restart:
        lammps([*start, "write_restart bed.restart"], folder, ranks)
        start = ["atom_modify map array", "newton off", "read_restart bed.restart", *laws]
        start += ["fix move all nve/sphere", f"fix down all gravity {GRAVITY} vector 0 0 -1"]
        start += ["neighbor 1e-3 bin", *ENERGY, "run 0", BOOKED]
    for _ in range(4):
        start += [f"run {settled}", BOOKED]
    return np.array(lammps(start, folder, ranks))


@pytest.mark.parametrize(
    ("ranks", "restart"), [(1, False), (2, False), (2, True)], ids=["one", "two", "restart"]
)
def test_no_atom_is_lost_momentum_is_kept_and_energy_falls(ranks, restart, scene):
    found = pour(scene, ranks, restart)
    atoms, moving, lifted, *along = found.T
    assert np.all(atoms == atoms[0])
    assert atoms[0] >= COUNT
    energy = moving + lifted
    assert np.all(np.diff(energy) < 0)
    assert moving[-1] < 0.8 * moving[0]
    masses = [
        float(MATERIALS[n].density) * 4 / 3 * np.pi * r**3
        for n, r in zip(BALLS, RADII, strict=True)
    ]
    most = np.sqrt(2 * moving[0] * sum(masses) * POURED / 2)  # Σ m |v| at most
    assert np.max(np.abs(np.diff(along, axis=1))) < 1e-9 * most


def cloud(scene) -> np.ndarray:
    """Frames of 180 spheres of both types between the plate and a lid: id, type, x, v, sorted by id."""
    folder, laws, step = scene
    rng = np.random.default_rng(5)
    grid = np.stack(np.meshgrid(*[np.arange(6) * 0.04 + 0.02] * 2, np.arange(5) * 0.02 + 0.01), -1)
    places = grid.reshape(-1, 3) + rng.uniform(-0.003, 0.003, (SOME, 3))
    lines = box(HIGH)
    for place in places:
        lines.append(f"create_atoms {1 + rng.integers(2)} single {' '.join(map(str, place))}")
    for kind in (1, 2):
        density = float(MATERIALS[BALLS[kind - 1]].density)
        lines.append(f"set type {kind} diameter {2 * RADII[kind - 1]} density {density}")
    lines += [
        "velocity all create 1.0 777 dist gaussian",
        "velocity all scale 2.0e19",
        *(line.replace("zplane 0 NULL", f"zplane 0 {LID}") for line in laws),
        "fix move all nve/sphere",
        "neighbor 1e-3 bin",
        f"dump frames all custom {EACH} cloud.dump id type x y z vx vy vz",
        'dump_modify frames sort id format line "%d %d %.15g %.15g %.15g %.15g %.15g %.15g"',
        f"run {int(0.3 / step)}",
    ]
    lammps(lines, folder)
    text = (folder / "cloud.dump").read_text(encoding="utf-8")
    rows = re.findall(r"^\d+ \d \S+ \S+ \S+ \S+ \S+ \S+ ?$", text, re.M)
    return np.loadtxt(rows).reshape(-1, SOME, 8)


def impacts(frames, step) -> dict[tuple[int, int], list[tuple[float, float]]]:
    """(v, ε) of contacts of two spheres, or of one and the plate (type 0), that touch nobody else.

    But grazing ones, whose normal turns meanwhile.
    """
    kind = frames[0, :, 1].astype(int)
    radius = np.array([0, *RADII])[kind]
    x, v = frames[..., 2:5], frames[..., 5:8]

    def apart(k, i, j):
        between = x[k, i] - x[k, j]
        between[..., :2] -= WIDE * np.round(between[..., :2] / WIDE)
        return between

    every = np.arange(SOME)
    touch = np.array(
        [
            np.linalg.norm(apart(k, every[:, None], every), axis=-1) < radius[:, None] + radius
            for k in range(len(frames))
        ]
    )
    floor = x[..., 2] < radius
    others = touch.sum(2) - 1 + floor + (x[..., 2] > LID - radius)
    found: dict[tuple[int, int], list[tuple[float, float]]] = {}

    def note(touching, normal_of, *spheres):
        """Each episode of contact, if nobody else is touched from the frame before to the one after."""
        edges = np.diff(touching.astype(int))
        for before in np.flatnonzero(edges == 1):
            ends = np.flatnonzero(edges[before:] == -1)
            after = before + ends[0] + 1 if ends.size else None
            if after and np.all(others[before : after + 1, spheres] <= 1):
                normal = normal_of((before + after) // 2)
                ends = [
                    v[k, spheres[0]] - sum(v[k, s] for s in spheres[1:]) for k in (before, after)
                ]
                one, two = (end @ normal for end in ends)
                along = np.linalg.norm(ends[0] - one * normal)
                turn = along * (after - before) * EACH * step / radius[list(spheres)].sum()
                if len(spheres) > 1 and turn * along > 0.01 * abs(one):
                    continue
                types = tuple(sorted((*kind[list(spheres)], *[0] * (2 - len(spheres)))))
                found.setdefault(types, []).append((-one, -two / one))

    for i in range(SOME):
        note(floor[:, i], lambda _: np.array([0.0, 0.0, 1.0]), i)
        for j in np.flatnonzero(touch[:, i].any(0)):
            if j > i:
                note(touch[:, i, j], lambda k, i=i, j=j: apart(k, i, j) / np.linalg.norm(apart(k, i, j)), i, j)  # fmt: skip
    return found


def test_impacts_of_all_pairs_follow_the_law(scene):
    found = impacts(cloud(scene), scene[2])
    names = dict(zip(((1, 1), (1, 2), (2, 2), (0, 1), (0, 2)), LAWS, strict=True))
    for key, name in names.items():
        velocity, restitution = np.array(found[key]).T
        some = velocity > 0.05
        expected = sj.restitution(LAWS[name], velocity[some]).coefficient
        off = np.abs(restitution[some] - expected)
        assert np.count_nonzero(some) >= 3, (name, found[key])
        assert np.max(off) < 0.02, (name, off, velocity[some])
