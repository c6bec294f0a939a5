"""Tracks z(t) as impacts, against films by an integrator of their own, closed forms, and what files look like."""

import math

import numpy as np
import pytest
from scipy import stats

import calibration as cal
import softjax as sj
from calibration import plots
from tests.coverage.runner import Case, study
from tests.decay import Decay
from tests.films import GRAVITY, Ball, Film

READ = cal.RestitutionData.from_table


def tracked(film, random, **options):
    """A film as a data set: in air, with the exposure stated."""
    time, height = film.frames(random)
    known = {
        "diameter": film.ball.diameter,
        "density": film.ball.density,
        "exposure": film.exposure,
    }
    return READ({"time": time, "height": height}, **known | options)


# ---------------------------------------------------------------- numbers


def parabolas(restitution, speeds, rate=200.0, contact=0.0):
    """Exact flights in vacuum between impacts of these speeds, each of the same ε, with a rest of `contact`."""
    pieces, start = [], 0.0
    for v in speeds:
        lasts = 2 * v / GRAVITY
        t = np.arange(math.ceil(start * rate) / rate, start + lasts, 1 / rate)
        pieces.append((t, v * (t - start) - GRAVITY / 2 * (t - start) ** 2))
        start += lasts + contact
    return np.concatenate([t for t, _ in pieces]), np.concatenate([z for _, z in pieces])


def test_exact_flights_give_exact_impacts_from_any_zero_unit_or_direction():
    speeds = 4.0 * 0.8 ** np.arange(5)
    time, height = parabolas(0.8, speeds)
    stated = {"air": False, "bounce_contact_time": 0.0}
    data = READ({"time": time, "height": height}, **stated)
    np.testing.assert_allclose(data.restitution, [0.8] * 4, rtol=1e-9)
    np.testing.assert_allclose(data.velocity, speeds[:-1], rtol=1e-9)
    (track,) = data.tracks
    assert track.gravity == pytest.approx(GRAVITY, rel=1e-9)
    # half a metre lower, in millimetres, downwards; a frame that shows nothing, and one that is wrong
    millimetres = 1000 * (0.5 - height)
    millimetres[30], millimetres[90] = np.nan, 1e4
    other = READ({"t [ms]": 1000 * time, "y / mm": millimetres}, **stated)
    np.testing.assert_allclose(other.restitution, [0.8] * 4, rtol=1e-8)
    assert any("read downwards" in remark for remark in other.remarks)
    # pixels: ε and v by g alone; slow motion, with its frame rate
    pixels = READ({"t": 8 * time, "y [px]": 700 * height}, frame_rate=200.0, **stated)
    np.testing.assert_allclose(pixels.restitution, [0.8] * 4, rtol=1e-9)
    np.testing.assert_allclose(pixels.velocity, speeds[:-1], rtol=1e-9)
    assert pixels.tracks[0].metre == pytest.approx(1 / 700, rel=1e-9)


def test_a_contact_that_is_stated_shown_by_the_floor_or_of_the_bodies_gives_the_same_impacts():
    """As flights in vacuum that rest for t_c: bare crossings would give 4.4177 m/s, and ε 0.0018 too large."""
    speeds, contact = 4.4 * 0.8 ** np.arange(6), 4e-3
    time, height = parabolas(0.8, speeds, 400.0, contact)
    table = {"time": time, "height": height}
    stated = READ(table, air=False, bounce_contact_time="4 ms")
    np.testing.assert_allclose(stated.velocity, speeds[:-1], rtol=1e-6)
    np.testing.assert_allclose(stated.restitution, [0.8] * 5, rtol=1e-6)
    nothing = READ(table, air=False, bounce_contact_time=0)
    assert nothing.restitution[0] - 0.8 == pytest.approx(0.00178, abs=1e-5)
    assert nothing.velocity[0] == pytest.approx(4.4174, abs=1e-4)
    # the floor shows it, but for how it goes with the velocity
    shown = READ(table, air=False)
    off = np.abs(shown.restitution - 0.8)
    assert np.all(off < 1.2 * shown.uncertainty)
    assert off[0] < 5e-4
    assert any("below the floor" in remark for remark in shown.remarks)
    two = READ({"time": time[time < 1.5], "height": height[time < 1.5]}, air=False)
    assert len(two) == 1
    assert any("taken as 0" in remark for remark in two.remarks)


def test_hertz_is_the_contact_of_stated_bodies_and_is_taken_off_the_intervals_between_bounces():
    rubber = sj.Material(3e6, 0.49, 1100.0, 1e6)
    pair = sj.Contact.with_wall(rubber, sj.STAINLESS_STEEL, 0.025)
    speeds = np.array([3.0, 2.4, 1.92])  # of arrivals: ε = 0.8
    duration = np.asarray(sj.restitution(sj.Hertz(pair), speeds).duration)
    flights = 2 * 0.8 * speeds / GRAVITY
    data = READ({"interval": flights + duration}, pair, air=False)
    # of the first bounce the arrival is known by the ratio of the next two
    np.testing.assert_allclose(data.restitution, [0.8, 0.8], atol=2e-5)
    np.testing.assert_allclose(data.velocity, speeds[1:], rtol=1e-4)
    assert any("less the contact of" in r and "Hertz" in r for r in data.remarks)
    times = np.cumsum([0.0, *(flights + 0.005)])
    for table in ({"time": times}, {"interval": np.diff(times)}):
        data = READ(table, air=False, bounce_contact_time=0.005)
        np.testing.assert_allclose(data.restitution, [0.8, 0.8], rtol=1e-12)
        unknown = READ(table, air=False)
        of_remark = float(unknown.remarks[0].partition(" by ")[2].split()[0])
        assert of_remark == pytest.approx(max(unknown.restitution - 0.8) / 5, rel=0.1)
    with pytest.raises(cal.DataError, match=r"bounce_contact_time.* shorter than the interval"):
        READ({"interval": [0.4, 0.3]}, bounce_contact_time=0.3)
    with pytest.raises(cal.DataError, match="left out but for times between bounces"):
        READ({"velocity": [1.0], "restitution": [0.9]}, bounce_contact_time=1e-3)


GOLF = Ball(0.0427, 1130, lambda v: 0.83 - 0.01 * v, 5e-4, 0.2)
RUBBER = Ball(0.05, 1100, lambda v: 0.82 - 0.02 * v, 8e-3, 0.2)
SHELL = Ball(0.066, 380, lambda v: 0.80 - 0.01 * v, 5e-3)
STEEL = Ball(0.025, 7800, lambda v: 0.9, 8e-5, 0.2)
GLASS = Ball(0.01, 2500, lambda v: 0.9, 3e-5, 0.2)
TABLE_TENNIS = Ball(0.04, 84, lambda v: 0.93 - 0.012 * v, 1e-3)
DROP = (1.0, 0.0)


def touching(ball, factor):
    """A contact with a rigid wall, of whose duration by Hertz's law that of the ball is one part in `factor`."""
    tau = 4 * math.sqrt(math.pi) * math.gamma(0.4) / (5 * math.gamma(0.9))
    mass = np.pi / 6 * ball.diameter**3 * ball.density
    stiffness = 1.25 * mass / (factor * ball.contact / tau) ** 2.5
    modulus = 0.75 * stiffness / math.sqrt(ball.diameter / 2)
    rubber, rigid = sj.Material(modulus, 0.0, ball.density, 1e6), sj.Material(1e16, 0.3, 8e3, 1e9)
    return sj.Contact.with_wall(rubber, rigid, ball.diameter / 2)


FILMS = {
    "30 golf": (Film(GOLF, DROP, 6, 30, 1e-3, 6e-4, 2e-3), {}),
    "50 table tennis": (Film(TABLE_TENNIS, DROP, 6, 50, 0.0, 3e-3), {}),
    "60 rubber": (Film(RUBBER, DROP, 6, 60, 1e-3, 1e-3), {}),
    "60 shell": (Film(SHELL, DROP, 6, 60, 2e-3, 1e-3), {}),
    "120 rubber": (Film(RUBBER, DROP, 6, 120, 1e-3, 1e-3), {"contact": touching(RUBBER, 1.1)}),
    "240 steel, pixels": (Film(STEEL, DROP, 8, 240, 5e-4, 3e-4, 1e-3), {}),
    "1000 glass": (Film(GLASS, (0.12, 0.0), 2, 1000, 1e-4, 1e-4), {"bounce_contact_time": 3.1e-5}),
    "5000 steel, one": (
        Film(STEEL, (0.01, -3.0), 1, 5000, 5e-5, 1e-4, 1e-4, ends=0.004),
        {"bounce_contact_time": 6.4e-5},
    ),
}


def errors_of(name, count):
    """Errors of ε over their standard uncertainties in `count` films, and the quantile of 95 % of each."""
    film, options = FILMS[name]
    random, off, quantiles = np.random.default_rng(4), [], []
    for _ in range(count):
        time, height = film.frames(random)
        key = "height"
        if "pixels" in name:  # of 0.8 mm, downwards
            key, height = "height [px]", 1000 - height / 8e-4
        ball = {"diameter": film.ball.diameter, "density": film.ball.density}
        data = READ({"time": time, key: height}, exposure=film.exposure, **ball, **options)
        truth = film.nearest(data.velocity)[:, 1]
        off += [*((data.restitution - truth) / data.uncertainty)]
        quantiles += [*stats.t.ppf(0.975, data.degrees)]
    assert len(off) > 0.95 * count * film.bounces
    return np.array(off), np.array(quantiles)


@pytest.mark.parametrize("name", ["30 golf", "60 shell", "240 steel, pixels"])
def test_uncertainties_of_a_few_films_are_those_of_their_errors(name):
    """√(mean z²) of 40 impacts that share errors lies within 0.7 to 1.35 in 99.9 %."""
    off, _ = errors_of(name, 7)
    assert 0.7 < np.sqrt(np.mean(off**2)) < 1.35


@pytest.mark.long
@pytest.mark.parametrize("name", FILMS)
def test_intervals_of_forty_films_hold_the_truth(name):
    off, quantiles = errors_of(name, 40)
    assert 0.91 < np.mean(np.abs(off) < quantiles) < 0.995
    assert 0.8 < np.sqrt(np.mean(off**2)) < 1.2


def test_drag_is_that_of_the_integrator_and_its_coefficient_moves_the_points_as_it_says():
    """An exact film of a table-tennis ball: without air ε would be 0.05 too low."""
    film = Film(TABLE_TENNIS, DROP, 4, 200)
    more = Film(Ball(0.04, 84, TABLE_TENNIS.restitution, 1e-3, drag=1.1), DROP, 4, 200)
    random = np.random.default_rng(0)
    options = {"bounce_contact_time": 1e-3}
    data, other = tracked(film, random, **options), tracked(more, random, **options)
    np.testing.assert_allclose(data.restitution, film.path.impacts[:, 2], atol=6e-4)
    np.testing.assert_allclose(data.velocity, film.path.impacts[:, 1], rtol=1.5e-3)
    with pytest.raises(cal.DataError, match=r"too small by .* or drag slows the ball"):
        tracked(film, random, air=False, **options)
    assert any(r.startswith("corrected for air") for r in data.remarks)
    # read with C_d of the first, the second ball has ε too low by what a tenth of C_d does
    missed = more.path.impacts[:, 2] - other.restitution
    np.testing.assert_allclose(data.errors.by_drag[:, 0] / 10, missed, rtol=0.15, atol=2e-4)
    golf = dict(zip(("time", "height"), FILMS["30 golf"][0].frames(random), strict=True))
    unknown = READ(golf)
    assert any("0.05 for table tennis" in remark for remark in unknown.remarks)


LEVEL, RATE = 0.85, 0.02


def films_of_one_ball(random):
    """Three films of a golf ball whose impacts scatter by 0.3 %, and whose drag is known to 10 %."""
    drag, rows = 1 + 0.1 * random.standard_normal(), []
    for k, height in enumerate((1.2, 0.8, 0.5)):

        def restitution(v):
            return LEVEL * np.exp(-RATE * v) * (1 + 0.003 * random.standard_normal())

        ball = Ball(0.0427, 1130, restitution, 6e-4, 0.2, drag)
        film = Film(ball, (height, 0.0), 5, 60, 1e-3, 1e-3)
        rows += [(f"film {k}", *frame) for frame in zip(*film.frames(random), strict=True)]
    table = dict(zip(("run", "time", "height"), zip(*rows, strict=True), strict=True))
    known = {"diameter": 0.0427, "density": 1130, "exposure": 1e-3, "bounce_contact_time": 4.6e-4}
    return READ(table, **known)


@pytest.mark.long
def test_intervals_of_a_laws_parameters_from_three_films_hold_the_truth():
    options, values = {"starts": 1, "profiles": False}, {"level": LEVEL, "rate": RATE}
    case = Case(law=Decay, values=values, simulate=films_of_one_ball, options=options)
    converged, every = study(case, 40)
    assert converged == 1
    low, high = stats.binom.interval(0.999, 40, 0.95)
    for found in every.values():
        assert low <= 40 * found.covered <= high
        assert 0.65 < found.ratio < 1.6


# ---------------------------------------------------------------- files


PLAIN = Film(RUBBER, DROP, 3, 60, 1e-3, 1e-3)
TIME, HEIGHT = PLAIN.frames(np.random.default_rng(2))
BALL = {"diameter": 0.05, "density": 1100.0}
KNOWN = READ({"time": TIME, "height": HEIGHT}, **BALL)


def text(*columns, sep=",", mark="."):
    rows = zip(*(map(str, column) for column in columns), strict=True)
    return "\n".join(sep.join(row).replace(".", mark) for row in rows) + "\n"


N = len(TIME)
FRAME, ACROSS = np.arange(N), np.linspace(0, 0.1, N)
DOWN = np.round(1200 - 1000 * HEIGHT, 4)
LAYOUTS = {  # a file, and options
    "heading and unit": "t / s,z / mm\n" + text(TIME, 1000 * HEIGHT),
    "Tracker": "mass_A,,\nt,x,y\n" + text(TIME, ACROSS, HEIGHT),
    "Tracker, tabs": "mass A\nt\tx\ty\n" + text(TIME, ACROSS, HEIGHT, sep="\t"),
    "Tracker, two objects": "mass_A,,,mass_B,,\nt,x,y,t,x,y\n"
    + text(TIME, ACROSS, ACROSS, TIME, ACROSS, HEIGHT),
    "Logger Pro": '"Run 1: Time (s)","Run 1: Position (m)","Run 1: Velocity (m/s)"\n'
    + text(TIME, HEIGHT, ACROSS),
    "Logger Pro, latest": '"Latest: Time (s)","Latest: Position (m)"\n' + text(TIME, HEIGHT),
    "Capstone": "Time (s) Run #1;Position (m) Run #1\n" + text(TIME, HEIGHT, sep=";", mark=","),
    "phyphox": '"Time (s)","Height (cm)"\n' + text(TIME, 100 * HEIGHT),
    "German": "Zeit (s);Höhe (cm)\n" + text(TIME, 100 * HEIGHT, sep=";", mark=","),
    "units in a row": "Time,Position\ns,m\n" + text(TIME, HEIGHT),
    "ImageJ": "Frame,X1,Y1,Flag1,X2,Y2,Flag2\n"
    + text(FRAME, ACROSS, DOWN, 0 * FRAME, 0 * FRAME + 5, 0 * FRAME + 9, 0 * FRAME),
    "ImageJ, manual": " ,Track n°,Slice n°,X,Y,Distance,Velocity,Pixel Value\n"
    + text(FRAME, 0 * FRAME + 1, FRAME, ACROSS, DOWN, ACROSS, ACROSS, FRAME),
    "ImageJ, in a plane": "TRACK_ID,POSITION_X,POSITION_Y,POSITION_Z,FRAME\n"
    + text(0 * FRAME, ACROSS, DOWN, 0 * FRAME, FRAME),
    "pixels": "time (s),y (px)\n" + text(TIME, DOWN),
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_files_as_programs_write_them_are_read_alike(read, name):
    by_frames = {"frame_rate": 60.0} if "ImageJ" in name else {}
    data = read(LAYOUTS[name], **BALL, **by_frames)
    np.testing.assert_allclose(data.restitution, KNOWN.restitution, atol=3e-5)
    np.testing.assert_allclose(data.velocity, KNOWN.velocity, rtol=2e-3)
    assert data.group is None


def test_runs_are_groups_objects_are_chosen_by_name_and_the_rows_of_impacts_are_theirs(read):
    side = "Time (s) Run #1,Position (m) Run #1,Time (s) Run #2,Position (m) Run #2\n"
    below = text(["a"] * N + ["b"] * N, [*TIME] * 2, [*HEIGHT] * 2)
    for content, names in (
        (side + text(TIME, HEIGHT, TIME, HEIGHT), ["Run #1", "Run #2"]),
        ("run,time (s),height (m)\n" + below, ["a", "b"]),
    ):
        data = read(content, **BALL)
        np.testing.assert_allclose(data.restitution, [*KNOWN.restitution] * 2, rtol=1e-9)
        assert list(data.groups) == names
        assert list(data.group).count(names[0]) == len(KNOWN)
    # rows next to the impacts, 2 lines further down in the file
    first = data.origin.lines[: len(KNOWN)]
    times = [crossing.time for crossing in KNOWN.tracks[0].crossings]
    assert [line - 2 for line in first] == [int(np.searchsorted(TIME, t)) for t in times]
    assert data.origin.lines[len(KNOWN)] == first[0] + N
    two = "mass_A,,mass_B,\nt,y,t,y\n" + text(TIME, HEIGHT, TIME, HEIGHT)
    with pytest.raises(ValueError, match=r"object must|`object` must|object is not stated"):
        read(two, **BALL)
    chosen = read(two, object="mass_A", **BALL)
    np.testing.assert_allclose(chosen.restitution, KNOWN.restitution, rtol=1e-9)
    with pytest.raises(ValueError, match="'mass_A', 'mass_B'"):
        read(two, object="mass_C", **BALL)


STILL = 1 + 1e-3 * np.random.default_rng(1).standard_normal(60)
REFUSED = {  # a table, options, and what is said
    "six frames": (
        (TIME[:6], HEIGHT[:6]),
        {},
        "of 9 frames or more, on two flights: an impact needs",
    ),
    "one flight": ((TIME[:25], HEIGHT[:25]), {}, "an impact needs one before and one after"),
    "back in time": (
        (np.r_[TIME, TIME], np.r_[HEIGHT, HEIGHT]),
        {},
        rf"time\[{N}\]. must be later",
    ),
    "slow motion": (
        (8 * TIME, HEIGHT),
        {},
        r"times are too large by a factor of 8\.0.*frame_rate = 60",
    ),
    "millimetres": ((TIME, 1000 * HEIGHT), {}, r"lengths are too large by a factor of (99|100)\d"),
    "a scale of 3 %": ((TIME, 1.03 * HEIGHT), {}, r"factor of 1\.03"),
    "the other way up": ((TIME, HEIGHT), {"down": True}, "must be false: heights are upwards"),
    "shown twice": (
        (np.arange(2 * N) / 120, np.repeat(HEIGHT, 2)),
        {},
        "every second frame repeats the last",
    ),
    "at rest": ((TIME[:60], STILL), {}, "no flight"),
    "of one height": ((TIME, 0 * HEIGHT), {}, "a ball that moves"),
    "no scale": ((TIME, HEIGHT), {"scale": -1.0}, "a positive length"),
    "no rate": ((TIME, HEIGHT), {"frame_rate": 0.0}, "a positive number of frames"),
    "its noise stated": (
        (TIME, HEIGHT),
        {"height_uncertainty": 1e-3},
        "whose frames show its noise",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_track_of_bounces_is_refused_with_the_way_in(name):
    (time, height), options, message = REFUSED[name]
    with pytest.raises(cal.DataError, match=message):
        READ({"time": time, "height": height}, **BALL, **options)


def test_frames_alone_need_their_rate_and_no_other_table_takes_what_is_of_a_track():
    with pytest.raises(cal.DataError, match="frame_rate"):
        READ({"frame": FRAME, "y [px]": HEIGHT}, **BALL)
    with pytest.raises(cal.DataError, match=r"`down` must be left out where the table is no track"):
        READ({"velocity": [1.0], "restitution": [0.9]}, down=True)


def test_hand_rest_gaps_and_smoothing_are_seen_and_said():
    random = np.random.default_rng(5)
    rest = 1e-3 * random.standard_normal(80)
    long = np.concatenate([1 + 1e-3 * random.standard_normal(60), HEIGHT, rest])
    data = READ({"time": np.arange(len(long)) / 60, "height": long}, **BALL)
    np.testing.assert_allclose(data.restitution, KNOWN.restitution, atol=2e-3)
    assert any("held, at rest or rolling" in remark for remark in data.remarks)
    gap = np.where(np.abs(TIME - KNOWN.tracks[0].crossings[1].time) < 0.1, np.nan, HEIGHT)
    data = READ({"time": TIME, "height": gap}, **BALL)
    assert len(data) == len(KNOWN) - 1
    assert any("impact not used: no flight is seen" in remark for remark in data.remarks)
    off = READ({"time": TIME, "height": 1.015 * HEIGHT}, **BALL)  # of 1.5 %: ε stays
    np.testing.assert_allclose(off.restitution, KNOWN.restitution, atol=2e-4)
    assert any("lengths may be off by +1." in remark for remark in off.remarks), off.remarks


# ---------------------------------------------------------------- fits


def test_scatter_is_estimated_by_itself_where_a_track_has_impacts_enough():
    """Four impacts and one parameter: three degrees of freedom. No other data are concerned."""

    def noises(data, **options):
        return cal.problem(data, "constant", **options).noises

    random = np.random.default_rng(3)
    data = tracked(Film(RUBBER, DROP, 4, 60, 1e-3, 1e-3), random)
    assert noises(data) == noises(data, extra_scatter=True) == ("noise",)
    assert noises(data, extra_scatter=False) == ()
    assert noises(data, scale_uncertainty=True) != ("noise",)
    assert (noises(KNOWN), noises(KNOWN, extra_scatter=True)) == ((), ("noise",))
    plain = cal.RestitutionData(data.velocity, data.restitution, uncertainty=0.01)
    assert noises(plain) == ()


def test_a_material_file_of_a_track_is_fitted_and_its_picture_shows_flights_and_impacts(
    read_toml, tmp_path
):
    toml = """[[material]]
name = "ball"
diameter = "50 mm"
density = 1100
frame_rate = 60
scale = "1 mm"
down = true
exposure = "1 ms"
bounce_contact_time = "7 ms"
data = "m.csv"
"""
    (data,) = read_toml(toml, "frame,y [px],x [px]\n" + text(FRAME, DOWN, DOWN))
    stated = {"exposure": 1e-3, "bounce_contact_time": 7e-3}
    known = READ({"time": TIME, "height": HEIGHT}, **BALL, **stated)
    np.testing.assert_allclose(data.restitution, known.restitution, atol=1e-5)
    # a smoothed track is fitted with a warning
    time, height = FILMS["60 rubber"][0].frames(np.random.default_rng(1))
    mean = np.convolve(height, np.ones(5) / 5, "valid")
    smooth = READ({"time": time[2:-2], "height": mean}, **BALL)
    result = cal.fit(smooth, "constant", extra_scatter=False, profiles=False, starts=1)
    assert "track" in [warning.code for warning in result.warnings]
    assert "track.png" in result.report(tmp_path / "out")
    axes = plots.track_figure(data.tracks, ["ball"]).axes
    lines = {line.get_label(): line.get_xydata() for line in axes[0].lines}
    impacts = lines["impacts, with ε"]
    np.testing.assert_allclose(impacts[:, 0], [c.time for c in data.tracks[0].crossings])
    below = np.min(impacts[:, 1]) - axes[0].get_ylim()[0]
    assert below > 0.15 * np.ptp(lines["frames of flights"][:, 1])  # room for the numbers of ε
    assert [t.get_text() for t in axes[0].texts] == [f"{e:.3f}" for e in data.restitution]
    assert len(lines["frames of flights"]) == sum(len(f.rows) for f in data.tracks[0].flights)


def test_flights_that_show_no_drag_are_read_as_in_vacuum():
    """A steel ball from 1 m, ε = 0.8 without air: frames exclude drag; `air=True` corrects them all the same."""
    g, fall, rate = 9.80665, (2 / 9.80665) ** 0.5, 60
    ends = np.cumsum([fall, *(2 * fall * 0.8**k for k in range(1, 5))])
    t = np.arange(0, ends[-1], 1 / rate)
    start = np.array([-fall, *ends[:-1]])
    k = np.searchsorted(ends, t, side="right")
    since = t - start[k]
    h = since * (g * fall * 0.8**k) - g * since**2 / 2
    h = h + 5e-5 * np.random.default_rng(0).standard_normal(len(t))
    steel = sj.Material(2.1e11, 0.3, 7800.0, 1e9)
    pair, table = sj.Contact.with_wall(steel, steel, 0.0125), {"time [s]": t, "height [m]": h}
    data = cal.RestitutionData.from_table(table, pair)
    assert data.restitution == pytest.approx(0.8, abs=2e-4)
    assert any("as in vacuum" in remark for remark in data.remarks)
    corrected = cal.RestitutionData.from_table(table, pair, air=True)
    assert corrected.restitution[0] > 0.8005
