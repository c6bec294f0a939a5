"""What fits and studies refuse: a call, and what its one line names."""

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import FITTED, MATERIALS, RADIUS, fitted
from tests.decay import Decay
from tests.fit_data import eq_17_data, twin

Free = cal.Parameter
LAW, DECAY = fitted("nylon"), Decay(0.9, 0.05)
CRITICAL = float(LAW.contact.critical_velocity)
DATA, NYLON = eq_17_data("nylon"), cal.of_spheres(MATERIALS["nylon"], RADIUS, **FITTED["nylon"])
V = np.linspace(1.0, 8.0, 8)
PLAIN = cal.RestitutionData(V, 0.9 - 0.02 * V, uncertainty=0.01)
UNSTATED = cal.RestitutionData(V, 0.9 - 0.02 * V)
TIMED = cal.RestitutionData(V, 0.9 - 0.02 * V, DATA.contact, contact_time=np.full(8, 1e-5))
POOLED = {"restitution": Free(shared="pooled")}
GROUPED = cal.RestitutionData(V, 0.9 - 0.02 * V, group=list("aabbccdd"))
# what only the status tells: 1.1 in the middle, 0.6 at both ends
INSIDE = cal.Inputs({"a": 0.4}, lambda x: sj.ConstantRestitution(None, 1.1 - 2 * x["a"] ** 2))
BOTH = cal.Inputs({"a": 0.9, "b": 0.9}, lambda x: sj.ConstantRestitution(None, x["a"] * x["b"]))
CHI = {"chi": (0.1, 1.0)}
QUICK = {"profiles": False, "starts": 1}


def zhou(contact, chi):
    return sj.Zhou(contact, chi, 0.4, 0.5)


def fit(data=DATA, law=None, **changed):
    return cal.fit(data, law, **changed)


def quick(law="constant", data=PLAIN, **changed):
    return cal.fit(data, law, **QUICK | changed)


def compare(data=PLAIN, laws=("constant",), **changed):
    return cal.compare(data, laws and list(laws), **changed)


def information(law=LAW, velocity=(0.5, 1.0, 5.0, 20.0, 40.0), *rest, **changed):
    return cal.fisher_information(law, velocity, *rest, **changed)


def design(law=DECAY, count=5, bounds=(1.0, 60.0), **changed):
    return cal.optimal_velocities(law, count, bounds, **changed)


def of_several_contacts():
    contact = sj.Contact.with_wall(sj.NYLON, sj.STAINLESS_STEEL, np.linspace(0.005, 0.02, 8))
    data = cal.RestitutionData(V, np.linspace(0.95, 0.88, 8), contact, 0.01)
    return quick("viscoelastic", data)


def above():
    return quick(None, twin("nylon", y=[2, 5, 9, 20, 40], noise=0.003))


def two_step():
    return quick(None, DATA, objective="two-step", route=sj.EnergyBalance())


# whole numbers, and the least of each
LEAST = {
    "bootstrap": (lambda **k: quick().bootstrap(**{"count": 1} | k), {"count": 1, "seed": 0}),
    "design": (design, {"count": 1, "starts": 1, "seed": 0}),
    "posterior": (lambda **k: quick().posterior(**k), {"draws": 4, "chains": 1, "seed": 0, "warmup": 50}),
}  # fmt: skip
AT_3 = ((information, [3.0]), (design, 3, (0.1, 8.0)))
ONLY_MODEL = r"`objective` must be model \(intervals come from `model`: `two-step` gives values alone\), but is two-step"
REFUSED = [
    # fits
    (lambda: fit(optimiser="bfgs"), '`optimiser` must be "l-bfgs"'),
    (lambda: fit(noise=np.array(["normal"] * 2)), '`noise` must be "normal"'),
    (lambda: fit(law="two-step"), "`law` must be left out: that is an objective"),
    (lambda: fit(law="hertz-dashpots"), "did you mean 'hertz-dashpot'"),
    (lambda: fit(law=3.0), "`law` must be a name"),
    (lambda: fit(parameters=3), "`parameters` must be a mapping"),
    (lambda: fit(3.0), "`data` must be"),
    (lambda: fit("nylon.csv"), "nylon.csv: no such file"),
    (lambda: fit(law=zhou), "`law` must be named otherwise than the built-in laws"),
    (lambda: fit(law=lambda contact, chi: zhou(contact, chi), objective="two-step"), '`objective` must be Zhou\'s law, or "model"'),
    (lambda: fit(objective="two-step", noise="student-t"), '`noise` must be "normal" with objective = "two-step"'),
    (lambda: fit(GROUPED, "constant", noise="student-t"), '`noise` must be "normal" where points share errors'),
    (lambda: fit(confidence="0.95"), '`confidence` must be a valid number without quotation marks, but is "0.95"'),
    (lambda: fit(profiles="no"), "`profiles` must be true or false, but is"),
    (lambda: fit(progress="bar"), r"`progress` must be True, or called as progress\(stage, done, total\)"),
    (lambda: fit(parameters={"form": "second"}), "`form` must be 'first-order' or 'full'"),
    (lambda: fit(parameters={"end": "near"}), "`end` must be left out with zhou .its options: form, kappa"),
    (lambda: fit(unloading_line="both"), "`unloading_line` must be"),
    (lambda: fit(parameters={"chi": [0.2]}), "must be a calibration.Parameter, or a number"),
    (lambda: fit(parameters={"chi[steel]": 1.0}), "must be named after one of: nylon"),
    (lambda: fit(parameters={"chii": 1.0}), "did you mean 'chi'"),
    (lambda: fit(law="linear", parameters={"stiffness": Free(unit="kN/m")}), "`unit of stiffness` must be N/m, as declared"),
    (lambda: fit(route="od"), "`route` must be .*did you mean 'ode'"),
    (lambda: fit([DATA, DATA]), "different names"),
    (lambda: fit([DATA, twin("chrome steel", area="hertz")], None, parameters={"chi": Free(shared=True)}), "`area` must be the same"),
    (lambda: fit(cal.RestitutionData([1.0, 2.0], [0.9, 0.8], DATA.contact)), r"2 points for 2 free parameters \(chi, eps_up\); more points than free parameters are needed"),
    (lambda: cal.fit(cal.RestitutionData([1.0], [0.9]), "constant"), r"1 point for 1 free parameter \(restitution\);"),
    (lambda: fit(TIMED, "constant"), "contact_time, of which constant determines"),
    (lambda: fit(TIMED, objective="two-step"), "`objective` must be model, which takes all of them"),
    (lambda: Free(shared="pooled", prior=(1, 1)), "`prior` must be left out"),
    (lambda: fit(PLAIN, "constant", parameters=POOLED), "left out for one data set alone"),
    *((lambda f=f, n=n, v=v: f(**{n: v}), rf"`{n}` must be a whole number >= {low}, but is {v}$") for f, least in LEAST.values() for n, low in least.items() for v in (low - 1, low + 0.5, True)),
    *((lambda d=d, o=o: cal.problem(d, "constant", **o).log_likelihood({"restitution": 0.9}), "`theta` must be with it: only plain normal noise is profiled") for d, o in ((UNSTATED, {"noise": "student-t"}), (GROUPED, {}))),
    # what is made of a fit
    (lambda: quick().band(1.0, observable="contact_tim"), "`observable` must be .*did you mean 'contact_time'"),
    *((lambda c=c: quick().band(1.0, confidence=c), "`confidence` must be between 0 and 1") for c in (95, True, "0.95")),
    (lambda: quick(parameters={"restitution": 0.9}).posterior(), "`parameters` must be one that is free, or noise"),
    # comparisons
    (lambda: compare(laws=["zhuo"]), "did you mean 'zhou'"),
    (lambda: compare(laws=[]), "one law or more"),
    (lambda: compare(DATA, ["hertz", "hertz"]), "twice Hertz"),
    (lambda: compare(DATA, ["hertz"], parameters={"zhou": {"form": "full"}}), r"parameters\['zhou'\]"),
    *((lambda p=p: compare(DATA, ["hertz"], parameters=p), "`parameters` must be a mapping") for p in (1.0, {"hertz": 1.0})),
    (lambda: compare(DATA, ["hertz"], parameters={"hertz": {"colour": 1.0}}), "Hertz: .*colour"),
    (lambda: compare(cal.RestitutionData(V[:5], np.full(5, 0.8), DATA.contact), None), "needs 6 or more"),
    (lambda: compare([PLAIN]), "one RestitutionData"),
    (lambda: compare(cal.RestitutionData(V, 0.9 - 0.02 * V, group=["a"] * 8)), "one group; two or more"),
    (lambda: compare(laws=["constant", "zhou"]), "Zhou.*: .*no elastic properties.*another law is needed"),
    # information
    (lambda: information("steel"), "law"),
    (lambda: information(fitted("nylon", chi=np.array([0.1, 0.2]))), "chi"),
    (lambda: information(fitted("nylon", sigma=0.0)), "sigma"),
    (lambda: information(LAW, [1.0, -1.0, 2.0, 3.0]), "velocity"),
    (lambda: information(quick(), [2.0, 0.0]), "`velocity` must be positive speeds in m/s"),
    (lambda: information(LAW, [1.0, 1e4, 2.0, 3.0]), "velocity"),
    (lambda: information(uncertainty=[0.01, 0.01, 0.01, 0.01, 0.0]), "uncertainty"),
    (lambda: information(material="nylon"), "material"),
    (lambda: information(parameters={"colour": 1.0}), "parameter"),
    (lambda: information(parameters={"psi": 0.7}), "the value of the law, 0.5414"),
    (lambda: information(parameters=dict.fromkeys(("chi", "sigma", "psi"), Free(free=False))), "none"),
    (lambda: information(above(), [0.5 * CRITICAL]), f"must be {CRITICAL:.4g} m/s or more, where this fit knows the law"),
    (lambda: information(quick(), [2.0], parameters={"restitution": 0.9}), "`parameters` must be left out"),
    *((lambda f=f: f(two_step()), ONLY_MODEL) for f in (*(lambda r, f=f, a=a: f(r, *a) for f, *a in AT_3), cal.FitResult.bootstrap, cal.FitResult.leave_one_out, cal.FitResult.posterior)),
    *((lambda f=f, a=a: f(of_several_contacts(), *a), "`contact` must be one for all impacts") for f, *a in AT_3),
    # designs
    (lambda: design(bounds=(2.0, 1.0)), "bounds"),
    (lambda: design(bounds=(1.0,)), r"`bounds` must be two numbers, \(low, high\)"),
    (lambda: design(LAW, bounds=(1.0, 1e4)), "velocity"),
    (lambda: design(criterion="G"), "criterion"),
    (lambda: design(target="eps"), "target"),
    (lambda: design(target="eps@fast"), "`target` must be eps@v with a velocity above 0 m/s, as eps@2, but is eps@fast"),
    (lambda: design(target="rate@2"), "`target` must be eps@v"),
    (lambda: design(LAW, target="eps@400"), "velocity"),
    (lambda: design(count=None), "`count` must be given, or precision in its place"),
    (lambda: design(precision=0.1), "`count` must be given, or precision in its place"),
    (lambda: design(count=None, precision=-0.1), "`precision` must be positive"),
    (lambda: design(count=None, precision=0.1, criterion="D"), "`precision` must be left out with criterion D"),
    (lambda: design(target="rate", criterion="D"), "`target` must be left out with criterion D"),
    (lambda: design(measured_uncertainty=0.1), "`measured_uncertainty` must be given with measured"),
    # sensitivities
    (lambda: cal.sensitivity("steel", 1.0), "`inputs`"),
    (lambda: cal.sensitivity(fitted("nylon", chi=np.array([1.0, 2.0])), 1.0), "`chi`"),
    (lambda: cal.sensitivity(LAW, -1.0), "`velocity`"),
]  # fmt: skip


@pytest.mark.parametrize("place", range(len(REFUSED)), ids=lambda k: f"{k} {REFUSED[k][1][:30]}")
def test_what_makes_no_sense_is_named_in_a_line(place):
    call, message = REFUSED[place]
    with pytest.raises(ValueError, match=message) as caught:
        call()
    assert str(caught.value).isprintable()
