"""One precision for all tests.

Programs are compiled as users' are: no flag or option is set that a user would not have.
"""

import atexit
import gc
import os
import shutil
import sys
import tempfile
from collections import Counter

import pytest

if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    # one worker's compilations serve the other, and whatever the tests start; commands keep none of
    # their own then, in the user's home
    shared = tempfile.mkdtemp(prefix="softjax-tests-")
    os.environ["JAX_COMPILATION_CACHE_DIR"] = shared
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    atexit.register(shutil.rmtree, shared, ignore_errors=True)

import jax
import numpy as np

import calibration as cal
import softjax as sj
from tests import records
from tests.cases import fitted
from tests.command import write_alloy

sj.enable_x64()
gc.set_threshold(500_000, 20, 100)  # traces are many objects, and live: looked through less often


def pytest_addoption(parser):
    parser.addoption(
        "--part", metavar="K/N", help="the K-th of N parts of the tests, by whole files"
    )
    parser.addoption(
        "--record",
        action="store_true",
        help="record what users see as it is now (pictures, reports, refusals, help, defaults, tables of"
        " pages) and print what changed",
    )


def pytest_configure(config):
    records.recording = config.getoption("--record")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item):
    report = yield
    report.user_properties += [("recorded", text) for text in records.changed()]
    return report


def pytest_terminal_summary(terminalreporter, config):
    """What every worker recorded, in one place."""
    if config.getoption("--record"):
        terminalreporter.section("recorded")
        reports = [r for some in terminalreporter.stats.values() for r in some]
        notes = [n for r in reports for n in getattr(r, "user_properties", ())]
        texts = dict.fromkeys(text for key, text in notes if key == "recorded")
        terminalreporter.write_line("\n\n".join(texts) or "Nothing changed.")


@pytest.hookimpl(trylast=True)  # after those that -m and -k leave out
def pytest_collection_modifyitems(config, items):
    # first those that clear what is compiled: others need not trace it again
    items.sort(key=lambda item: item.path.name != "test_compilation.py")
    if part := config.getoption("--part"):
        k, count = map(int, part.split("/"))
        if not 1 <= k <= count:
            raise pytest.UsageError(f"--part must be K/N with K from 1 to N, but is {part}")
        mine = dealt(Counter(str(item.path) for item in items), count)[k - 1]
        config.hook.pytest_deselected(items=[i for i in items if str(i.path) not in mine])
        items[:] = [item for item in items if str(item.path) in mine]


def dealt(files: dict[str, int], count: int) -> list[list[str]]:
    """Files in `count` parts of nearly as many tests; those of a file share what they compile."""
    parts: list[list[str]] = [[] for _ in range(count)]
    for file in sorted(files, key=lambda file: (-files[file], file)):
        min(parts, key=lambda part: sum(map(files.get, part))).append(file)
    return parts


MOST_MAPPED = 45_000  # of the parts of memory that Linux lets a process have, 65 530


def _mapped() -> int:
    try:
        with open("/proc/self/maps", "rb") as parts:
            return sum(1 for _ in parts)
    except OSError:  # not on every system
        return 0


@pytest.fixture(scope="module", autouse=True)
def programs_make_room():
    """A compiled program takes some parts of memory, and many tests compile very many."""
    yield
    if _mapped() > MOST_MAPPED:
        jax.clear_caches()
        gc.collect()


@pytest.fixture(scope="module", autouse=True)
def only_what_the_readme_installs(request):
    """Samplers are hidden, where they are installed, from all tests whose file does not import them."""
    with pytest.MonkeyPatch.context() as patch:
        for name in () if hasattr(request.module, "blackjax") else ("blackjax", "arviz", "xarray"):
            patch.setitem(sys.modules, name, None)
        yield


@pytest.fixture
def compiled():
    """The compilations since the test began, by name."""
    names = []

    def listen(event, duration, **details):
        if event == "/jax/core/compile/backend_compile_duration":
            names.append(details.get("fun_name", "?"))

    jax.monitoring.register_event_duration_secs_listener(listen)
    yield names
    jax.monitoring.unregister_event_duration_listener(listen)


@pytest.fixture
def at(tmp_path, monkeypatch):
    """A directory to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def quick(tmp_path_factory):
    """A material file that is soon fitted."""
    folder = tmp_path_factory.mktemp("quick")
    return write_alloy(folder, 'law = "constant"\nprofiles = false')


@pytest.fixture(scope="session")
def above_yield(tmp_path_factory):
    """A fit that determines nothing below first yield, and its file."""
    law, velocity = fitted("nylon"), np.geomspace(1.5, 60.0, 24)
    noise = 0.003 * np.random.default_rng(4).normal(size=24)
    measured = np.asarray(sj.restitution(law, velocity).coefficient) + noise
    data = cal.RestitutionData(velocity, measured, law.contact, 0.003, name="my\nnylon")
    result = cal.fit(data, profiles=False, starts=4)
    path = tmp_path_factory.mktemp("fit") / "fit.json"
    result.save(path)
    return result, str(path)
