"""A scene in LAMMPS from exported files alone: balls of two materials above a plate of a third."""

import re

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import FITTED, MATERIALS
from tests.export.lammps import SPHERES, build, lammps, needs_lammps

pytestmark = [needs_lammps, pytest.mark.long, pytest.mark.codes]
BALLS = ("stainless steel", "nylon")  # types 1 and 2
PLATE = "chrome steel"
RADII = (0.005, 0.006)
WIDE, HIGH = 0.28, 1.2  # the plate and the box [m]
KEPT = ("ke", "pe", "vcm(all,z)*mass(all)", "f_floor_one[1]+f_floor_two[1]")
BOOK = f'print "RESULT {" ".join(f"$({name}:%.17g)" for name in KEPT)}"'
SOME, LID, EACH = 180, 0.12, 4  # spheres and the height of the cloud [m], steps between frames
SLOW = 0.05  # ε is held below [m/s]


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
    folder = tmp_path_factory.mktemp("cloud")
    lines, steps = [], []
    for name, law in LAWS.items():
        made = cal.export(
            law,
            "lammps",
            folder,
            velocity_range=(SLOW, 5.0),
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


@pytest.fixture(scope="module")
def cloud(scene) -> tuple[np.ndarray, np.ndarray]:
    """180 spheres of both types between the plate and a lid."""
    folder, laws, step = scene
    rng = np.random.default_rng(5)
    grid = np.stack(np.meshgrid(*[np.arange(6) * 0.04 + 0.02] * 2, np.arange(5) * 0.02 + 0.01), -1)
    places = grid.reshape(-1, 3) + rng.uniform(-0.003, 0.003, (SOME, 3))
    lines = [
        *SPHERES,
        "boundary p p fm",
        "newton off",
        f"region box block 0 {WIDE} 0 {WIDE} 0 {HIGH}",
        "create_box 2 box",
    ]
    for place in places:
        lines.append(f"create_atoms {1 + rng.integers(2)} single {' '.join(map(str, place))}")
    for kind in (1, 2):
        density = float(MATERIALS[BALLS[kind - 1]].density)
        lines.append(f"set type {kind} diameter {2 * RADII[kind - 1]} density {density}")
    lines += [
        "velocity all create 1.0 777 dist gaussian",
        "velocity all scale 2.0e19",
        *(line.replace("zplane 0 NULL", f"zplane 0 {LID}") for line in laws),
        *(f"fix_modify {name} energy yes" for name in ("floor_one", "floor_two")),
        "fix move all nve/sphere",
        "thermo_modify norm no",
        "run 0",
        BOOK,
        "neighbor 1e-3 bin",
        f"dump frames all custom {EACH} cloud.dump id type x y z vx vy vz",
        'dump_modify frames sort id format line "%d %d %.15g %.15g %.15g %.15g %.15g %.15g"',
        f"run {int(0.3 / step)}",
        BOOK,
    ]
    booked = np.array(lammps(lines, folder))
    text = (folder / "cloud.dump").read_text(encoding="utf-8")
    rows = re.findall(r"^\d+ \d \S+ \S+ \S+ \S+ \S+ \S+ ?$", text, re.M)
    return np.loadtxt(rows).reshape(-1, SOME, 8), booked


def impacts(frames, step) -> tuple[np.ndarray, np.ndarray]:
    """Contacts of two spheres, or of one with the plate or the lid: types (the plate's is 0), v, ε; which are clean."""
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
    walls = np.array([x[..., 2] < radius, x[..., 2] > LID - radius])
    others = touch.sum(2) - 1 + walls.sum(0)
    rows, clean = [], []

    def note(touching, normal_of, *spheres):
        edges, size = np.diff(touching.astype(int)), radius[list(spheres)].sum()
        for before in np.flatnonzero(edges == 1):
            ends = np.flatnonzero(edges[before:] == -1)
            if not ends.size:
                continue
            after = before + ends[0] + 1
            normal = normal_of((before + after) // 2)
            ends = [v[k, spheres[0]] - sum(v[k, s] for s in spheres[1:]) for k in (before, after)]
            one, two = (end @ normal for end in ends)
            sliding = np.linalg.norm(ends[0] - one * normal)
            lasting = (after - before) * EACH * step
            turns = len(spheres) > 1 and sliding**2 * lasting > 0.01 * abs(one) * size
            types = sorted((*kind[list(spheres)], *[0] * (2 - len(spheres))))
            rows.append((*types, -one, -two / one))
            clean.append(np.all(others[before : after + 1, spheres] <= 1) and not turns)

    for i in range(SOME):
        for side, wall in enumerate(walls):
            note(wall[:, i], lambda _, up=1.0 - 2 * side: np.array([0.0, 0.0, up]), i)
        for j in np.flatnonzero(touch[:, i].any(0)):
            if j > i:
                note(touch[:, i, j], lambda k, i=i, j=j: apart(k, i, j) / np.linalg.norm(apart(k, i, j)), i, j)  # fmt: skip
    return np.array(rows), np.array(clean)


KEYS = dict(zip(LAWS, ((1, 1), (1, 2), (2, 2), (0, 1), (0, 2)), strict=True))


def test_impacts_of_all_pairs_follow_the_law_and_take_its_energy(cloud, scene):
    """Each ε within the tolerance of the export; Σ M v² (1 - ε²)/2 is all that the contacts took."""
    frames, booked = cloud
    found, clean = impacts(frames, scene[2])
    taken = 0.0
    for name, types in KEYS.items():
        of_pair = np.all(found[:, :2] == types, axis=1)
        velocity, restitution = found[of_pair, 2:].T
        expected = np.asarray(sj.restitution(LAWS[name], np.maximum(velocity, SLOW)).coefficient)
        taken += float(LAWS[name].contact.mass) * np.sum(velocity**2 * (1 - expected**2)) / 2
        sample = clean[of_pair] & (velocity > SLOW)
        off = np.abs(restitution - expected)[sample]
        assert np.count_nonzero(sample) >= 3, (name, velocity)
        assert np.max(off) < 0.02, (name, off, velocity[sample])
    change, given, momentum, impulse = np.diff(booked, axis=0)[0]
    assert given == pytest.approx(-change, rel=1e-4)
    assert momentum == pytest.approx(impulse, rel=1e-9)
    assert given == pytest.approx(taken, rel=0.01)
