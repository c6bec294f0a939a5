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
COUNT, POURED = 10_000, (5_500, 5_000)  # spheres at least, and asked for of each type
WIDE, HIGH = 0.28, 1.2  # the plate and the box at the start [m]
TOPS, SPEED = (0.68, 1.18), 1.0  # from where each type is poured [m], and how fast [m/s]
SOON = 300  # steps: a few contacts, before rounding grows
BOOK_CLOUD = 'print "RESULT $(ke:%.17g) $(pe+f_floor_one+f_floor_two:%.17g)"'
SOME, LID, EACH = 180, 0.12, 4  # spheres and the height of the cloud [m], steps between frames
GRAVITY = 9.81
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
    folder = tmp_path_factory.mktemp("pour")
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


def box(high: float) -> list[str]:
    return [
        "units si",
        "atom_style sphere",
        "atom_modify map array",
        "boundary p p fm",
        "newton off",
        f"region box block 0 {WIDE} 0 {WIDE} 0 {high}",
        "create_box 2 box",
    ]


MOVES = [
    "fix move all nve/sphere",
    f"fix down all gravity {GRAVITY} vector 0 0 -1",
    *(f"fix_modify {name} energy yes" for name in ("down", "floor_one", "floor_two")),
    "neighbor 1e-3 bin",
    "thermo_modify norm no lost error",
    "compute_modify thermo_temp dynamic/dof yes",
]
NUMBERS = (
    "time",
    "atoms",
    "mass(one)",
    "mass(two)",
    "ke",
    "etotal",
    "f_floor_one[1]+f_floor_two[1]",
)
NUMBERS += tuple(f"vcm(all,{axis})*mass(all)" for axis in "xyz")
BOOK = f'print "RESULT {" ".join(f"$({name}:%.17g)" for name in NUMBERS)}"'


def soon(name: str) -> list[str]:
    """A few steps, and where all spheres are then."""
    form = 'format line "%d %.17g %.17g %.17g %.17g %.17g %.17g"'
    return [f"run {SOON}", f"write_dump all custom {name} id x y z vx vy vz modify sort id {form}"]


def bed(folder, name: str) -> np.ndarray:
    """x and v of all spheres, places over the plate in the box, in the order of their IDs."""
    found = np.loadtxt(folder / name, skiprows=9)[:, 1:]
    found[:, :2] %= WIDE
    return found


def later(step: float, times: int) -> list[str]:
    return [f"run {int(0.1 / step)}", BOOK] * times


@pytest.fixture(scope="module", params=[1, 2], ids=["one rank", "two ranks"])
def poured(request, scene):
    """Ranks, and the balances of a pour: 0.4 s after the spheres appear, and each 0.1 s from there on."""
    (folder, laws, step), ranks = scene, request.param
    lines = [*box(HIGH), *laws, *MOVES]
    for kind, (name, top) in enumerate(zip(("one", "two"), TOPS, strict=True), 1):
        rho, region = float(MATERIALS[BALLS[kind - 1]].density), f"above{kind}"
        lines.append(f"region {region} block 0 {WIDE} 0 {WIDE} {top - 0.48} {top}")
        lines.append(
            f"fix pour{kind} {name} pour {POURED[kind - 1]} {kind} {4711 + kind} region {region} vol 0.25 500 "
            f"dens {rho} {rho} vel 0 0 0 0 {-SPEED} diam one {2 * RADII[kind - 1]}"
        )
    lines += [f"run {int(0.4 / step)}", BOOK, "unfix pour1", "unfix pour2"]
    lines += [f"write_restart bed{ranks}.restart", *soon(f"bed{ranks}.dump"), BOOK, *later(step, 5)]
    return ranks, np.array(lammps(lines, folder, ranks))


def balanced(found: np.ndarray) -> None:
    """Momentum and energy from each time to the next: none is lost but to the plate and to contacts."""
    time, atoms, one, two, moving, energy, impulse, *momentum = found.T
    assert np.all(atoms == atoms[0])
    assert atoms[0] >= COUNT
    mass = one + two
    scale = mass[0] * np.sqrt(2 * moving[0] / mass[0])
    assert np.max(np.abs(np.diff(momentum[:2], axis=1))) < 1e-9 * scale
    change = np.diff(momentum[2]) - np.diff(impulse) + mass[0] * GRAVITY * np.diff(time)
    assert np.max(np.abs(change)) < 1e-9 * scale
    assert np.max(np.abs(np.diff(energy))) < 1e-4 * moving[0]


def test_momentum_and_energy_of_a_pour_are_booked(poured):
    """From the energy that the spheres are poured with, v²/2 + g h of each, on."""
    _, found = poured
    balanced(found)
    _, _, one, two, _, energy, *_ = found.T
    given = sum(m[0] * (SPEED**2 / 2 + GRAVITY * h) for m, h in zip((one, two), TOPS, strict=True))
    np.testing.assert_allclose(energy, given, rtol=1e-4)


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_pour_goes_on_from_a_restart(ranks, poured, scene):
    """As without one, by as many ranks or others: at first sphere by sphere, then in its balances."""
    (folder, laws, step), (before, found) = scene, poured
    lines = ["atom_modify map array", "newton off", f"read_restart bed{before}.restart", *laws]
    lines += [*MOVES, "run 0", BOOK, *soon("again.dump"), BOOK, *later(step, 2)]
    again = np.array(lammps(lines, folder, ranks))
    off = np.abs(bed(folder, "again.dump") - bed(folder, f"bed{before}.dump"))
    off[:, :2] = np.minimum(off[:, :2], WIDE - off[:, :2])
    assert np.max(off[:, :3]) < 1e-10
    assert np.max(off[:, 3:]) < 1e-8
    balanced(again)
    np.testing.assert_allclose(again[:, 4], found[: len(again), 4], rtol=0.02)


@pytest.fixture(scope="module")
def cloud(scene) -> tuple[np.ndarray, np.ndarray]:
    """180 spheres of both types between the plate and a lid.

    Frames of id, type, x, v, sorted by id; kinetic energy and what contacts have taken at the start and the end.
    """
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
        "thermo_modify norm no",
        "run 0",
        BOOK_CLOUD,
        "neighbor 1e-3 bin",
        f"dump frames all custom {EACH} cloud.dump id type x y z vx vy vz",
        'dump_modify frames sort id format line "%d %d %.15g %.15g %.15g %.15g %.15g %.15g"',
        f"run {int(0.3 / step)}",
        BOOK_CLOUD,
    ]
    booked = np.array(lammps(lines, folder))
    text = (folder / "cloud.dump").read_text(encoding="utf-8")
    rows = re.findall(r"^\d+ \d \S+ \S+ \S+ \S+ \S+ \S+ ?$", text, re.M)
    return np.loadtxt(rows).reshape(-1, SOME, 8), booked


def impacts(frames, step) -> tuple[np.ndarray, np.ndarray]:
    """Contacts of two spheres, or of one with the plate or the lid: types (the plate's is 0), v, ε; which are clean.

    Clean ones touch nobody else from the frame before to the one after, and their normal hardly turns meanwhile.
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
    lost, given = -np.diff(booked, axis=0)[0] * (1, -1)
    assert given == pytest.approx(lost, rel=1e-4)
    assert given == pytest.approx(taken, rel=0.01)
