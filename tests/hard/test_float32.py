"""What float32 holds: ε of the three materials within 1e-6, its error over the boxes bounded.

`python -m tests.hard.float32_errors` prints the errors of value and gradient over more impacts.
"""

import json
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests import cases
from tests.hard.float32_errors import EPS, errors, of_material
from tests.physics import boxes

ROUTES = {"energy balance": sj.EnergyBalance(), "ode": sj.ODE(rtol=1e-6)}
CHOICES = (boxes.Choice(), boxes.Choice("full", "hertz", "printed"))
over_curves = pytest.mark.parametrize("material", cases.MATERIALS)
over_forms = pytest.mark.parametrize(
    "form", [pytest.param(f, marks=[pytest.mark.long] * k) for k, f in enumerate(cases.FORMS)]
)
over_routes = pytest.mark.parametrize(
    "route",
    [pytest.param(r, id=n, marks=[pytest.mark.long] * (n == "ode")) for n, r in ROUTES.items()],
)


@over_curves
@over_forms
@over_routes
def test_materials(material, form, route):
    """SI inputs in, 1e-6 of 40-digit arithmetic out, with float64 switched on and not used."""
    assert of_material(material, form, route) <= 1e-6


def law_in_float32(material: str, form: str) -> sj.Zhou:
    """The fitted law from properties that are float32 from the start."""
    given = jax.tree.leaves(cases.MATERIALS[material])
    own = sj.Material(*(np.asarray(value, np.float32) for value in given))
    radius = np.asarray(cases.RADIUS, np.float32)
    pair = sj.Contact.between_spheres(own, own, radius, radius)
    fitted = {name: np.asarray(x, np.float32) for name, x in cases.FITTED[material].items()}
    return sj.Zhou(pair, **fitted, form=form)


@over_curves
@over_forms
def test_materials_in_float32_from_the_start(material, form):
    records = [r for r in cases.of_form("curves", form) if r["material"] == material]
    velocity = cases.column(records, "inputs", "v").astype(np.float32)
    result = sj.restitution(law_in_float32(material, form), velocity)
    error = np.float64(result.coefficient) - cases.column(records, "eps")
    assert np.all(np.abs(error) <= 1e-6)
    assert result.coefficient.dtype == np.float32
    assert np.array_equal(result.status, cases.flags_of(records))


WITHOUT_X64 = """
import json, sys
import jax, numpy as np
import softjax as sj
from tests import cases
from tests.hard.float32_errors import of_material
assert not jax.config.jax_enable_x64
alone = sj.restitution(cases.fitted("nylon"), 2.0).coefficient
assert alone.dtype == np.float32
print(json.dumps({name: of_material(name, sys.argv[1], None) for name in cases.MATERIALS}))
"""


@over_forms
def test_materials_without_x64(form):
    """A process that never asks for float64."""
    command = [sys.executable, "-W", "error", "-c", WITHOUT_X64, form]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert set(found) == set(cases.MATERIALS)
    assert max(found.values()) <= 1e-6


@over_forms
@over_routes
def test_no_hidden_float64(form, route):
    """Nothing in the traced computation is wider than what went in, gradient included."""
    law = law_in_float32("nylon", form)

    def total(law, v):
        return sj.restitution(law, v, route).coefficient.sum()

    velocity = np.linspace(0, 20, 7, dtype=np.float32)
    traced = jax.make_jaxpr(jax.value_and_grad(total, argnums=(0, 1)))(law, velocity)
    kinds = [var.aval for eqn in equations(traced.jaxpr) for var in eqn.outvars]
    floats = [kind for kind in kinds if kind.shape and kind.dtype.kind == "f"]
    assert any(kind.dtype == np.float32 for kind in floats)
    # a choice between two Python numbers is weakly typed: it widens nothing that it meets
    assert [kind for kind in floats if kind.dtype != np.float32 and not kind.weak_type] == []


def equations(jaxpr):
    """Those of a traced computation and of all within it."""
    for eqn in jaxpr.eqns:
        yield eqn
        params = list(eqn.params.values())
        for inner in jax.tree.leaves(params, is_leaf=lambda p: hasattr(p, "eqns")):
            if hasattr(inner, "eqns"):
                yield from equations(getattr(inner, "jaxpr", inner))


@pytest.mark.long
@pytest.mark.parametrize("choice", CHOICES, ids=lambda choice: choice.form)
def test_over_the_boxes(choice):
    """|Δε²| within 32 eps (1 + Σ|∂ε²/∂ln θ|), slopes of mild impacts mostly within 100 eps."""
    found = [errors(seed, 5000, choice) for seed in range(4)]
    sensitivity, value, slope = (
        np.concatenate(part) for part in list(zip(*found, strict=True))[:3]
    )
    assert np.all(value <= 32 * EPS * (1 + sensitivity))
    assert np.quantile(slope[sensitivity < 1], 0.99) <= 100 * EPS
    assert sum(batch.not_finite for batch in found) == 0
    assert sum(batch.wrong for batch in found) == 0
    assert len(value) > 17_500


class Squared(sj.RateIndependentLaw):
    """A spring of stiffness n², both ways; n is declared as a number, no more."""

    contact: sj.Contact
    n: float

    def loading_force(self, overlap):
        return self.n**2 * overlap

    def unloading_force(self, overlap, peak_overlap):
        return self.n**2 * overlap


@pytest.mark.long
def test_whole_numbers_of_a_law_do_not_overflow():
    """n² is beyond what 32 bits hold of whole numbers; δ_max = v √M/n."""
    pair = cases.pair("stainless steel")
    with jax.enable_x64(False):
        many = sj.restitution(Squared(pair, jnp.array([100_000, 200_000])), 1.0)
        traced = jax.jit(sj.restitution)(Squared(pair, 100_000), 1.0)
        of_traced = jax.jit(lambda n: sj.restitution(Squared(pair, n), 1.0))(100_000)
    one = np.sqrt(pair.mass) / 100_000
    for found, expected in ((many, [one, one / 2]), (traced, one), (of_traced, one)):
        assert found.peak_overlap.dtype == np.float32
        assert np.allclose(found.peak_overlap, expected, rtol=1e-6, atol=0)
