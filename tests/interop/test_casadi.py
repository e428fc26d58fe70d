"""Functions of CasADi: values and exact derivatives beside those of the model, and what they do not have."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from sympy import Piecewise, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from corpus.named_scenes import READY
from dalembert.errors import CapabilityError

ca = pytest.importorskip("casadi", reason="extra not installed")


def cart(load=0):
    """Return a cart with an input, a spring and a first-order state, and its load."""
    x, push, z, N, O = *dynamicsymbols("x push z"), ReferenceFrame("N"), Point("O")
    m, k = symbols("m k", positive=True)
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("cart", O.locatenew("P", x * N.x), m))
    scene.add_inputs(push)
    scene.add_states({z: x - z})
    scene.add_loads((scene.bodies[0].masscenter, (push - k * x + load) * N.x))
    return scene


@pytest.mark.parametrize("formulation", ["minimal", "projected"])
@pytest.mark.parametrize("name", ["chaplygin_sleigh", "rolling_sphere", "edge_plate"])
def test_values_are_those_of_the_model(name, formulation):
    case = READY[f"ready: {name}"]
    model = da.compile_model(case.build(), formulation=formulation)
    run = model.simulate((0, 0.2), case.initial, case.parameters)
    q, qdot = run.q[-1], run.qdot[-1]
    p = [case.parameters[item] for item in model.layout.parameters]
    functions, x, t = model.to_casadi(), np.concatenate([q, qdot]), run.t[-1]
    expected = {
        "accelerations": model.accelerations(t, q, qdot, p),
        "mass_matrix": model.mass_matrix(q, p),
        "constraint_jacobian": model.constraint_jacobian(t, q, p),
        "forcing": model.forcing(t, q, qdot, p),
    }
    for kind, values in expected.items():
        found = np.array(functions[kind](t, x, p, []))
        np.testing.assert_allclose(found.reshape(np.shape(values)), values, rtol=1e-11, atol=1e-11, err_msg=kind)
        assert found.shape == np.shape(values) or found.shape == (*np.shape(values), 1)
    assert float(ca.sum1(functions["energy"](t, x, p, []))) == pytest.approx(run["energy"][-1], rel=1e-12)


def test_derivatives_are_exact_and_runs_of_its_integrator_agree():
    model = da.compile_model(cart(), outputs=["x_ddot"])
    assert model.layout.state == ("x", "x_dot", "z")
    functions, p = model.to_casadi(), [3.0, 2.0]  # k, m
    rates = functions["rhs"]
    assert rates.name_in() == ["t", "y", "p", "u"]
    np.testing.assert_allclose(np.array(rates(0, [1, 2, 3], p, [5])).ravel(), [2, (5 - 3) / 2, -2])
    by_state = np.array(rates.jacobian()(0, [1, 2, 3], p, [5], [0, 0, 0])[1])
    np.testing.assert_allclose(by_state, [[0, 1, 0], [-1.5, 0, 0], [1, 0, -1]], atol=1e-15)
    by_input = np.array(rates.jacobian()(0, [1, 2, 3], p, [5], [0, 0, 0])[3])
    np.testing.assert_allclose(by_input.ravel(), [0, 0.5, 0])
    y, k = ca.SX.sym("y", 3), ca.SX.sym("p", 2)
    equations = {"x": y, "p": k, "ode": rates(0, y, k, [5])}
    end = ca.integrator("run", "cvodes", equations, 0, 1.5, {"reltol": 1e-11, "abstol": 1e-12})(x0=[1, 2, 3], p=p)["xf"]
    start, numbers = {"x": 1, "x_dot": 2, "z": 3}, {"k": 3, "m": 2}
    run = model.simulate((0, 1.5), start, numbers, inputs={"push": 5}, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(np.array(end).ravel(), run.y[-1], rtol=1e-8)
    outputs = np.array(functions["outputs"](0, [1, 2, 3], p, [5])).ravel()
    assert dict(zip(model.layout.outputs, outputs, strict=True))["x_ddot"] == 1.0


def test_what_functions_of_casadi_do_not_have():
    x, t = dynamicsymbols("x"), dynamicsymbols._t
    table = da.table(x, [-2, -1, 1, 2], [3, 1, -1, -3], kind="cubic", extrapolate="linear")
    with pytest.raises(CapabilityError, match="tables or compiled functions"):
        da.compile_model(cart(table)).to_casadi()
    with pytest.raises(CapabilityError, match="kinks or jumps"):
        da.compile_model(cart(Piecewise((1, t < 1), (0, True)))).to_casadi()
    with pytest.raises(CapabilityError, match=r"contacts that change.*model\.mode"):
        da.compile_model(da.scenes.bouncing_ball()).to_casadi()


def test_the_page_of_optimal_control_quotes_what_its_script_prints(capsys):
    script = Path(__file__).parents[2] / "docs" / "ipopt.py"
    runpy.run_path(str(script))
    printed = capsys.readouterr().out
    assert printed and f"```text\n{printed}```" in script.with_suffix(".md").read_text()
