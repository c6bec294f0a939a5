"""The numbers the paper prints, and the misprints listed beside them, recomputed."""

import math

import pytest

import softjax as sj
from softjax import paper
from tests.cases import FITTED, pair

ENTRIES = {entry.name: entry for entry in paper.TABLE_1}
MISPRINTS = {misprint.place: misprint for misprint in paper.MISPRINTS}


def misprint(start):
    """The one whose place starts so."""
    (found,) = (m for place, m in MISPRINTS.items() if place.startswith(start))
    return found


def test_the_table_is_the_printed_one():
    printed = {
        "stainless steel": (0.0082, 340, 3.0432, 0.5400, 354.75, 0.1368),
        "chrome steel": (0.9090, 882, 0.1418, 0.3114, 54.25, 0.0239),
        "nylon": (0.8352, 324, 0.4355, 0.5414, 34.34, 0.0160),
    }
    for name, numbers in printed.items():
        entry = ENTRIES[name]
        assert numbers == (
            entry.critical_velocity,
            entry.limit_velocity,
            entry.sigma,
            entry.psi,
            entry.yield_ratio,
            entry.chi,
        )
    assert set(printed) == set(ENTRIES)


@pytest.mark.parametrize("name", ENTRIES)
def test_the_library_gives_the_printed_digits(name):
    entry, contact = ENTRIES[name], pair(name)
    assert (entry.sigma, entry.psi) == (FITTED[name]["sigma"], FITTED[name]["psi"])
    assert contact.limit_velocity == pytest.approx(entry.limit_velocity, abs=0.5)
    assert contact.yield_ratio == pytest.approx(entry.yield_ratio, abs=0.01)
    listed = {"chrome steel": misprint("Table 1, chrome").derived_value}
    critical = listed.get(name, entry.critical_velocity)
    assert contact.critical_velocity == pytest.approx(critical, abs=5e-5)


@pytest.mark.parametrize("name", ENTRIES)
def test_unloading_line(name):
    """Eq. (18) gives Table 1's χ̃ but for nylon's."""
    entry = ENTRIES[name]
    c1, c2 = paper.UNLOADING_LINE
    listed = {"nylon": misprint("Table 1, nylon").derived_value}
    assert c1 + c2 * entry.yield_ratio == pytest.approx(listed.get(name, entry.chi), abs=5e-5)


def test_misprints_are_misprints():
    assert pair("chrome steel").critical_velocity != pytest.approx(0.9090, abs=5e-4)
    nylon = misprint("Table 1, nylon")
    assert abs(nylon.printed_value - nylon.derived_value) > 3e-4
    line = misprint("Eq. (18)")
    assert line.printed_value == pytest.approx(1e6 * line.derived_value)


@pytest.mark.parametrize("name", ENTRIES)
def test_kappa(name):
    """κ is 36 (π/2)^{8/3} (Y/E)² as printed and (9/16) π^{8/3} (Y/E)² as the forces have it."""
    listed = misprint("below Eq. (10)")
    assert listed.printed_value == pytest.approx(36 * (math.pi / 2) ** (8 / 3), rel=1e-9)
    assert listed.derived_value == pytest.approx(9 / 16 * math.pi ** (8 / 3), rel=1e-9)
    contact = pair(name)
    for kappa, factor in (("printed", listed.printed_value), ("consistent", listed.derived_value)):
        law = sj.Zhou(contact, 0.1, 0.1, 0.5, kappa=kappa)
        assert 1.5 * law.plasticity() * contact.yield_ratio**2 == pytest.approx(factor, rel=1e-8)
    # π² b² Y²/k^{4/3} with Hertz's b is what area="hertz" has
    hertz = sj.Zhou(pair(name, "hertz"), 0.1, 0.1, 0.5)
    own = 1.5 * hertz.plasticity() * contact.yield_ratio**2
    assert own == pytest.approx(5.55, abs=5e-3)


def test_hertz_b():
    listed = misprint("Eq. (2)")
    assert listed.printed_value == pytest.approx(3 * math.pi / 4, rel=1e-12)
    assert listed.derived_value == 3 / 4
