"""Two processes on one machine: values, slopes and files are those of one; one that ends, and the restart."""

import io
import os
import shutil
import signal
import socket
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest

from calibration.cli import main
from calibration.coverage.table import Coverage, as_arrays, from_arrays
from calibration.errors import DataError
from calibration.parts import Parts, blocks, fingerprint
from calibration.processes import place_of

ROOT = Path(__file__).parents[1]


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def started(command, index, **more):
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    env = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_", "SLURM_", "PMI_"))}
    return subprocess.Popen(command(index), cwd=ROOT, env=env | {"JAX_PLATFORMS": "cpu"}, **pipes)


def by_two(command):
    """What two processes of a command told, and their exit codes."""
    both = [started(command, k) for k in (0, 1)]
    told = [one.communicate(timeout=100) for one in both]
    return told, [one.returncode for one in both]


def by_one(*options, out):
    """One process, of its own too: in the tests' one LLVM optimises less, and linear algebra may have
    other threads, which an ulp tells."""
    command = [sys.executable, "-m", "calibration", *options, "--out", str(out)]
    with started(lambda _: command, 0) as alone:
        error = alone.communicate(timeout=100)[1]
    assert alone.returncode == 0, error


def softjax(*options, out):
    port = free_port()

    def command(k):
        place = ["--coordinator", f"127.0.0.1:{port}", "--process", str(k), "--processes", "2"]
        return [sys.executable, "-m", "calibration", *options, "--out", str(out), *place]

    return command


ARRAYS = """
import sys
import jax
k, port = int(sys.argv[1]), sys.argv[2]
jax.config.update("jax_cpu_collectives_implementation", "gloo")
jax.config.update("jax_disable_most_optimizations", True)
jax.distributed.initialize(f"127.0.0.1:{port}", 2, k)
import numpy as np
import calibration as cal, softjax as sj
from jax.sharding import AxisType, NamedSharding, PartitionSpec
from calibration.coverage.batched import coverage_study
from calibration.coverage.cases import standard_cases
sj.enable_x64()
assert (jax.device_count(), jax.local_device_count()) == (2, 1)
pair = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, 0.0127, 0.0127)
law = sj.WaltonBraun(pair, 1e6, 2e6, 60.0)
alone = np.linspace(0.0, 200.0, 600_000)  # each half goes piece by piece
expected, share = sj.restitution(law, alone), slice(k * 300_000, (k + 1) * 300_000)
each = NamedSharding(jax.make_mesh((2,), ("x",), axis_types=(AxisType.Auto,)), PartitionSpec("x"))
velocity = jax.make_array_from_process_local_data(each, alone[share])

def half(leaf, whole):
    (here,) = leaf.addressable_shards  # the other half is not in this process
    assert leaf.shape == (600_000,) and here.data.shape == (300_000,), leaf.sharding
    assert np.allclose(here.data, np.asarray(whole)[share], rtol=1e-12, atol=1e-15)

traced = jax.jit(lambda velocity: sj.restitution(law, velocity))
for hit in (sj.restitution(law, velocity), traced(velocity)):
    half(hit.coefficient, expected.coefficient)
    half(hit.status, expected.status)
    half(hit.velocity, alone)
half(hit.law.growth, np.full(600_000, 60.0))
text = traced.lower(velocity).compile().as_text()
assert not [word for word in ("all-gather", "all-to-all", "collective-permute") if word in text]
total = lambda law, velocity: sj.restitution(law, velocity).coefficient.sum()
by_law, slope = jax.jit(jax.grad(total, (0, 1)))(law, alone)
found, slopes = jax.jit(jax.grad(total, (0, 1)))(law, velocity)
half(slopes, slope)
assert np.isclose(found.growth, by_law.growth, rtol=1e-11)
try:
    sj.restitution(law, jax.make_array_from_process_local_data(each, -alone[share]))
except ValueError as error:
    assert "velocity" in str(error)
else:
    raise AssertionError("negative velocities were taken")

nylon = cal.RestitutionData(alone[1000:9000:1000], expected.coefficient[1000:9000:1000], pair)
fitted = cal.fit(nylon, "constant", profiles=False, starts=1)
made = fitted.bootstrap(300, seed=1, parts=sys.argv[3])
assert np.array_equal(made.values, fitted.bootstrap(300, seed=1).values)
case = [one for one in standard_cases((8,)) if one.name.startswith("constant")]
shared, whole = coverage_study(case, 20, parts=sys.argv[3]), coverage_study(case, 20)
for one, other in zip(shared, whole, strict=True):
    assert one.name == other.name
    assert np.array_equal(one.estimates["restitution"], other.estimates["restitution"])
"""


def test_arrays_of_two_processes_stay_in_halves(tmp_path):
    """Values, slopes, a bootstrap and a study: those of one process, each of the two with its half."""
    port = str(free_port())
    told, codes = by_two(
        lambda k: [sys.executable, "-c", ARRAYS, str(k), port, str(tmp_path / "parts")]
    )
    assert codes == [0, 0], told[0][1][-1500:] + told[1][1][-1500:]


CURVE = ("curve", "nylon", "--from", "0.1", "--to", "60")


def test_the_files_of_a_curve_are_those_of_one_process(tmp_path, monkeypatch):
    options = (*CURVE, "--points", "140000", "--format", "csv", "npy", "png")
    told, codes = by_two(softjax(*options, out=tmp_path / "two"))
    assert codes == [0, 0], told
    assert "140000 velocities" in told[0][0]  # the first one speaks for all
    assert told[1] == ("", "")
    by_one(*options, out=tmp_path / "one")
    names = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert names == ["curve.csv", "curve.npy", "curve.png"]
    assert sorted(path.name for path in (tmp_path / "two").iterdir()) == names  # no parts are left
    for name in names:
        assert (tmp_path / "two" / name).read_bytes() == (tmp_path / "one" / name).read_bytes()


def _finds_open_mpi() -> bool:
    """One by which JAX finds the coordinator."""
    if shutil.which("mpirun") is None:
        return False
    told = subprocess.run(["mpirun", "--version"], capture_output=True, text=True)
    return "(Open MPI) 4." in told.stdout


@pytest.mark.long
def test_open_mpi_starts_several(tmp_path):
    if not _finds_open_mpi():
        pytest.skip("needs Open MPI 4")
    options = (*CURVE, "--points", "140000", "--format", "npy")
    launch = ["mpirun", "--allow-run-as-root", "--oversubscribe", "-n", "3", sys.executable]
    command = [*launch, "-m", "calibration", *options, "--out", str(tmp_path / "three")]
    with started(lambda _: command, 0) as launched:
        told, error = launched.communicate(timeout=100)
    assert launched.returncode == 0, error
    assert told.count("140000 velocities") == 1
    by_one(*options, out=tmp_path / "one")
    made = [(tmp_path / name / "curve.npy").read_bytes() for name in ("three", "one")]
    assert made[0] == made[1]


def test_a_process_that_is_killed_ends_the_other_and_a_restart_goes_on(tmp_path):
    """One line and a code; what is whole is not made again."""
    options = (*CURVE, "--points", "4000000", "--format", "npy")
    command, out = softjax(*options, out=tmp_path), tmp_path / "parts"
    made = lambda: sorted(out.glob("[0-9a-f]*/0*"))  # noqa: E731
    with started(command, 0) as first, started(command, 1) as second:
        try:
            while not made():
                assert first.poll() is None, first.communicate()
                time.sleep(0.02)
            second.send_signal(signal.SIGKILL)
            error = first.communicate(timeout=60)[1]
        finally:
            first.kill()
            second.kill()
    if first.returncode == 0:
        pytest.skip("the killed process had made all of its parts")
    assert first.returncode == 3
    assert error.count("\n") == 1
    assert error.startswith("softjax: process 1 of 2 ended before its parts were made")
    whole = made()
    assert len(whole) < 62  # of as many parts
    marked = whole[0]
    marked.write_bytes(_with_another_row(marked))
    assert (
        main([*options, "--out", str(tmp_path), *_alone(free_port())]) == 0
    )  # one goes on for two
    rows = np.load(tmp_path / "curve.npy")
    assert len(rows) == 4_000_000
    assert np.sum(rows["restitution"] == 0.125) == 1  # it was taken as it was
    assert np.all(np.diff(rows["velocity"]) > 0)


def _with_another_row(path):
    part = dict(np.load(path))
    part["coefficient"][7] = 0.125
    made = io.BytesIO()
    np.savez(made, **part)
    return made.getvalue()


def _alone(port):
    return ["--coordinator", f"127.0.0.1:{port}", "--process", "0", "--processes", "1"]


def test_what_is_whole_is_not_made_again(tmp_path):
    made = []

    def make(k):
        made.append(k)
        if k == 2 and len(made) == 3:
            raise OSError("no space")
        return {"x": np.full(3, float(k))}

    with pytest.raises(OSError, match="could not be written"), Parts(tmp_path) as parts:
        parts.arrays("settings", 4, make)
    with Parts(tmp_path) as parts:
        found = parts.arrays("settings", 4, make)
        assert made == [0, 1, 2, 2, 3]
        assert [one["x"][0] for one in found] == [0.0, 1.0, 2.0, 3.0]
        parts.arrays("others", 4, make)  # of other settings none is taken
        assert made[5:] == [0, 1, 2, 3]


def test_processes_that_make_something_else_are_told(tmp_path):
    nothing = lambda: None  # noqa: E731
    with Parts(tmp_path, 0, 2, meet=nothing) as parts:
        (tmp_path / "asked-1").write_text("0123456789abcdef\n")
        with pytest.raises(ValueError, match="process 1 of 2 makes something else"):
            parts.files("settings", 2, lambda k, path: path.touch())
        parts.count = 1  # nobody to wait for


def test_settings_tell_one_job_from_another():
    import softjax as sj

    pair = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, 0.01, 0.01)
    told = [
        fingerprint(sj.Thornton(pair, 1.6), 3),
        fingerprint(sj.Thornton(pair, 1.7), 3),
        fingerprint(sj.Thornton(pair, 1.6), 4),
        fingerprint(sj.Zhou(pair, 1.6, 1, 1), 3),
        fingerprint(sj.Zhou(pair, 1.6, 1, 1, form="full"), 3),
        fingerprint(b"1.6", 3),
    ]
    assert len(set(told)) == len(told)
    assert fingerprint(sj.Thornton(pair, 1.6), 3) == told[0]
    assert fingerprint(test_settings_tell_one_job_from_another) == fingerprint(
        test_settings_tell_one_job_from_another
    )


def test_a_study_as_arrays_is_itself():
    x = {"e": np.arange(3.0)}
    one = Coverage("a case, n = 8", 3, 1.0, {"e": 0.9}, {}, {"e": 0.1}, {"e": 0.1}, x, x, 0.5)
    other = from_arrays({k: np.asarray(v) for k, v in as_arrays(one).items()})
    assert {**vars(one), "estimates": 0, "errors": 0} == {
        **vars(other),
        "estimates": 0,
        "errors": 0,
    }
    assert np.array_equal(other.estimates["e"], x["e"])


class Options:
    def __init__(self, coordinator=None, process=None, processes=None):
        self.coordinator, self.process, self.processes = coordinator, process, processes


@pytest.mark.parametrize(
    ("told", "argument"),
    [
        (Options(process=0), "--process, --processes"),
        (Options(process=0, processes=2), "--coordinator"),
        (Options("here:1", 2, 2), "--process"),
        (Options("here:1"), "--process"),
    ],
)
def test_options_that_do_not_fit_together(told, argument):
    with pytest.raises(DataError) as error:
        place_of(told)
    assert error.value.argument == argument


@pytest.mark.parametrize(
    ("variables", "place"),
    [
        ({}, None),
        ({"OMPI_COMM_WORLD_RANK": "1", "OMPI_COMM_WORLD_SIZE": "4"}, (1, 4)),
        ({"SLURM_PROCID": "2", "SLURM_STEP_NUM_TASKS": "3"}, (2, 3)),
        ({"SLURM_PROCID": "0", "SLURM_NTASKS": "3"}, None),  # a batch script, no step of it
        ({"PMI_RANK": "0", "PMI_SIZE": "1"}, None),
    ],
)
def test_launchers_tell_a_process_its_place(variables, place, monkeypatch):
    for name in list(os.environ):
        if name.startswith(("OMPI_", "SLURM_", "PMI_")):
            monkeypatch.delenv(name)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert place_of(Options()) == place


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ([*CURVE, "--table"], "--table"),
        (["sensitivity", "nylon", "--study", "local"], "global"),
    ],
)
def test_what_one_process_does_alone(options, told, tmp_path, capsys):
    assert main([*options, "--out", str(tmp_path / "out"), *_alone(free_port())]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert told in error


def test_blocks_cover_all_rows():
    assert blocks(7, 3) == [slice(0, 3), slice(3, 6), slice(6, 7)]
    assert blocks(0, 3) == []


@pytest.mark.long
def test_a_global_study_by_two_processes(tmp_path):
    options = ("sensitivity", "nylon", "--study", "global", "--samples", "16384", "--at", "2")
    told, codes = by_two(softjax(*options, out=tmp_path / "two"))
    assert codes == [0, 0], textwrap.shorten(str(told), 2000)
    by_one(*options, out=tmp_path / "one")
    one, two = ((tmp_path / k / "sensitivity.json").read_text() for k in ("one", "two"))
    assert one == two
