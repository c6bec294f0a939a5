"""What float32 holds: ε of the three materials within 1e-6, from inputs of either precision."""

import json
import subprocess
import sys

import jax
import numpy as np
import pytest

import softjax as sj
from tests import cases

over_forms = cases.mostly_long("form", cases.FORMS)
ROUTES = [sj.EnergyBalance(), sj.ODE(rtol=1e-6)]


def in_float32(name: str, form: str) -> sj.Zhou:
    """The fitted law from properties that are float32 from the start."""
    given = jax.tree.leaves(cases.MATERIALS[name])
    material = sj.Material(*(np.asarray(value, np.float32) for value in given))
    radius = np.asarray(cases.RADIUS, np.float32)
    pair = sj.Contact.between_spheres(material, material, radius, radius)
    fitted = {key: np.asarray(x, np.float32) for key, x in cases.FITTED[name].items()}
    return sj.Zhou(pair, **fitted, form=form)


def of_materials(form: str, route=None, law=cases.fitted) -> float:
    """Largest |Δε| over the reference curves, from SI inputs, against 40-digit arithmetic."""
    worst = []
    for name in cases.MATERIALS:
        records = [r for r in cases.of_form("curves", form) if r["material"] == name]
        velocity = cases.column(records, "inputs", "v").astype(np.float32)
        result = sj.restitution(law(name, form), velocity, route)
        assert result.coefficient.dtype == np.float32
        assert np.all(cases.same_flags(result.status, cases.flags_of(records)))
        worst.append(np.max(np.abs(np.float64(result.coefficient) - cases.column(records, "eps"))))
    assert len(worst) == 3
    return float(max(worst))


@over_forms
@cases.mostly_long("route", ROUTES)
@pytest.mark.parametrize("law", [cases.fitted, in_float32], ids=["float64", "float32"])
def test_materials(form, route, law):
    """1e-6 of 40-digit arithmetic, from numbers of either precision, with float64 switched on."""
    assert of_materials(form, route, law) <= 1e-6


WITHOUT_X64 = """
import json, sys
import jax
import softjax as sj
from tests import cases
from tests.hard.test_float32 import of_materials
assert not jax.config.jax_enable_x64
print(json.dumps(of_materials(sys.argv[1])))
"""


@over_forms
def test_materials_without_x64(form):
    """A process that never asks for float64."""
    command = [sys.executable, "-W", "error", "-c", WITHOUT_X64, form]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) <= 1e-6


@over_forms
@pytest.mark.parametrize("route", ROUTES, ids=["energy", "ode"])
def test_no_hidden_float64(form, route):
    """Nothing in the traced computation is wider than what went in, gradient included."""

    def total(law, v):
        return sj.restitution(law, v, route).coefficient.sum()

    velocity = np.linspace(0, 20, 7, dtype=np.float32)
    law = in_float32("nylon", form)
    traced = jax.make_jaxpr(jax.value_and_grad(total, argnums=(0, 1)))(law, velocity)
    kinds = [var.aval for eqn in equations(traced.jaxpr) for var in eqn.outvars]
    floats = [kind for kind in kinds if kind.shape and kind.dtype.kind == "f"]
    assert any(kind.dtype == np.float32 for kind in floats)
    # a choice between two Python numbers is weakly typed: it widens nothing that it meets
    assert [kind for kind in floats if kind.dtype != np.float32 and not kind.weak_type] == []


def test_slopes_of_stages_by_the_equation_of_motion():
    """ε = √(k1/k2): ∂ε/∂k2 = -ε/(2 k2)."""
    pair = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, cases.RADIUS, cases.RADIUS)
    law = jax.tree.map(np.float32, sj.WaltonBraun(pair, 1e6, 2e6))
    slope = jax.grad(
        lambda law: sj.restitution(law, np.float32(1.0), sj.ODE(rtol=1e-6)).coefficient
    )
    found = slope(law).unloading_stiffness
    assert found.dtype == np.float32
    assert found * 4e6 == pytest.approx(-(0.5**0.5), rel=1e-5)


def equations(jaxpr):
    """Those of a traced computation and of all within it."""
    for eqn in jaxpr.eqns:
        yield eqn
        params = list(eqn.params.values())
        for inner in jax.tree.leaves(params, is_leaf=lambda p: hasattr(p, "eqns")):
            if hasattr(inner, "eqns"):
                yield from equations(getattr(inner, "jaxpr", inner))


class Squared(sj.HardSphereLaw):
    """ε² = 1e9/n²; n is declared as a number, no more."""

    n: float

    def restitution_squared(self, velocity):
        return 1e9 / self.n**2 + 0 * velocity


def test_whole_numbers_of_a_law_do_not_overflow():
    """n² is beyond what 32 bits hold of whole numbers."""
    with jax.enable_x64(False):
        found = jax.jit(lambda n: sj.restitution(Squared(n), 1.0).coefficient)(100_000)
    assert found.dtype == np.float32
    assert np.allclose(found, np.sqrt(0.1), rtol=1e-6, atol=0)
