"""What a contact time and a second size tell that restitutions of one size do not."""

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.fit_data import pair

QUICK = {"profiles": False, "starts": 4}
PAIR = pair("stainless steel")
V = np.geomspace(0.1, 2.0, 24)


@pytest.mark.parametrize(
    ("law", "name", "truth", "power"),
    [
        (lambda: sj.LinearSpringDashpot(PAIR, 3e6, 0.8), "stiffness", 3e6, 2.0),
        (lambda: sj.Hertz(PAIR), "contact.youngs_modulus", float(PAIR.youngs_modulus), 2.5),
    ],
)
def test_contact_times_alone_tell_what_restitutions_do_not(law, name, truth, power):
    """t ∝ K^-1/2 and E^-2/5: times of 2 % give a stiffness to 4 %/√n, E to 5 %/√n."""
    random = np.random.default_rng(3)
    times = np.asarray(sj.restitution(law(), V).duration)
    times = times * (1 + 0.02 * random.standard_normal(len(V)))
    data = cal.RestitutionData(
        V, contact=PAIR, contact_time=times, contact_time_uncertainty=0.02 * times
    )
    parameters = {name: cal.Parameter(), **({"restitution": 0.8} if name == "stiffness" else {})}
    result = cal.fit(data, type(law()), parameters, **QUICK)
    expected = power * 0.02 / len(V) ** 0.5 * truth
    assert result.standard_errors[name] == pytest.approx(expected, rel=0.05)
    assert abs(result.values[name] - truth) < 4 * expected


def sized(radii, seed=2):
    """Rebounds of nylon as a viscoelastic law has them, one size or two."""
    random = np.random.default_rng(seed)
    v = np.tile(np.geomspace(0.2, 3.0, 12), len(radii))
    radius = np.repeat(radii, 12)
    contact = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, radius, radius)
    law = sj.ViscoelasticHertz(contact, 2e-6)
    eps = np.asarray(sj.restitution(law, v).coefficient) + 0.003 * random.standard_normal(len(v))
    return cal.RestitutionData(v, eps, contact, 0.003)


def test_two_sizes_tell_a_viscoelastic_law_from_one_without_the_size():
    """1 - ε ∝ v^(1/5)/R at equal v; of one size Zhou's law, which has no R, follows it as well."""
    laws = ["viscoelastic", "zhou"]
    one, two = (cal.compare(sized(radii), laws) for radii in ([0.008], [0.004, 0.012]))
    label = next(name for name in two.ranking if name.startswith("Zhou"))
    assert two.ranking[1] == label
    assert -one.entry(label).delta_elpd.value < 10
    assert -two.entry(label).delta_elpd.value > 500


def test_what_contact_times_say_of_the_modulus_is_told(tmp_path):
    """E stays as stated: off by 10 % it is warned of; and the pictures draw a curve for each size."""
    random = np.random.default_rng(1)
    radius = np.repeat([0.004, 0.012], 12)
    v = np.tile(np.geomspace(0.2, 2.0, 12), 2)
    contact = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, radius, radius)
    hit = sj.restitution(sj.ViscoelasticHertz(contact, 2e-6), v)
    times = np.asarray(hit.duration) * (1 + 0.02 * random.standard_normal(24))
    eps = np.asarray(hit.coefficient) + 0.003 * random.standard_normal(24)
    options = {"contact_time": times, "contact_time_uncertainty": 0.02 * times}
    for factor, off in ((1.0, False), (1.1, True)):
        stated = sj.Contact(
            **{**contact.leaves(), "youngs_modulus": factor * contact.youngs_modulus}
        )
        data = cal.RestitutionData(v, eps, stated, 0.003, **options)
        result = cal.fit(data, "viscoelastic", profiles=False, starts=4)
        (found,) = [w.cause for w in result.warnings if w.code == "modulus"] or [""]
        assert bool(found) == off
    assert 0.9 < float(found.split("those of ")[1].split()[0]) < 0.92  # 1/1.1, ± 1 %
    assert "which they determine to 1 %" in found  # 2.5 · 2 %/√24
    assert "observables.png" in result.report(tmp_path)
    report = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "the contact times would determine E to 1 %" in report
    assert "| contact time t_c | 24 |" in report
    band = result.band(v[:12], impact=20)
    pair = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, 0.012, 0.012)
    one = sj.Contact(**{**pair.leaves(), "youngs_modulus": 1.1 * pair.youngs_modulus})
    law = sj.ViscoelasticHertz(one, result.values["dissipation_time"])
    expected = sj.restitution(law, v[:12]).coefficient
    np.testing.assert_allclose(band.coefficient, expected, rtol=1e-9)


def test_information_and_designs_count_what_sensors_show():
    """Contact times of 2 % tell a spring's stiffness to 4 %/√n; ε alone does not tell it."""
    law, sensors = sj.LinearSpringDashpot(PAIR, 3e6, 0.8), {"contact_time": 0.02}
    found = cal.optimal_velocities(law, 6, (0.1, 3.0), criterion="D", sensors=sensors)
    again = cal.fisher_information(law, found.velocity, sensors=sensors)
    for name, error in again.relative_errors.items():
        assert found.relative_errors[name] == pytest.approx(error, rel=1e-6)
    assert found.without["stiffness"] is None
    assert found.efficiency > 0.99
    assert "K: 1.6 % (not determined)" in str(found)
    assert found.to_dict()["without_sensors"] == found.without
    law = sj.LinearSpringDashpot(PAIR, 3e6, 0.8)
    found = cal.fisher_information(law, V, uncertainty=0.01, sensors={"contact_time": 0.02})
    assert found.relative_errors["stiffness"] == pytest.approx(0.04 / len(V) ** 0.5, rel=1e-2)
    assert found.without["stiffness"] is None
    assert found.relative_errors["restitution"] <= found.without["restitution"]
    assert "K: 0.82 % (not determined)" in str(found)
    # t ∝ E^-2/5 and F ∝ E^2/5 of an elastic contact, whose ε is 1 whatever E is
    sensors, modulus = {"contact_time": 0.02, "peak_force": 0.05}, "contact.youngs_modulus"
    parameters = {modulus: cal.Parameter()}
    hertz = cal.fisher_information(sj.Hertz(PAIR), V, sensors=sensors, parameters=parameters)
    expected = (len(V) * ((0.4 / 0.02) ** 2 + (0.4 / 0.05) ** 2)) ** -0.5
    assert hertz.relative_errors[modulus] == pytest.approx(expected, rel=1e-3)
    assert hertz.without[modulus] is None
