"""A mass that rests where its force jumps or has a kink, until a pull begins: models, pulls, and ends of runs."""

import numpy as np
import pytest
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from table_cases import m, x

N, O = ReferenceFrame("N"), Point("O")
u, v, TIME = dynamicsymbols("u"), x.diff(), dynamicsymbols._t
TIGHT = {"rtol": 1e-10, "atol": 1e-12, "max_steps": 3000}
KNOT = 1.5
PULLS = {
    "hold": (da.samples([0.0, 1.0, 2.0], [0.0, -3.0, -3.0], "hold"), (-3.0, -1.5)),
    "linear": (da.samples([0.0, 1.0, 2.0], [0.0, 0.0, -3.0], "linear"), (-1.5, -0.5)),
}
"""Pulls from t = 1 on, with the speed and the displacement that they alone give a mass of 1 kg by t = 2."""


def pulled(force, backend="llvm", *, inputs=(u,), formulation="auto", **options):
    """Return the model of a mass on a line under a force, with a second coordinate that it drags along by a rod."""
    y = dynamicsymbols("y")
    P, Q = O.locatenew("P", x * N.x), O.locatenew("Q", y * N.x)
    scene = da.Scene("pulled", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("mass", P, 0.5 * m), Particle("other", Q, 0.5 * m))
    scene.add_holonomic_constraints(y - x - 0.25)
    scene.add_inputs(*inputs)
    scene.add_loads((P, force * N.x))
    for controller in options.pop("controllers", ()):
        scene.add_controllers(controller)
    return da.compile_model(scene, backend=backend, formulation=formulation, **options)


def ends(made, span, method, inputs=None, count=3):
    """Return final position and speed (k, 2): of a single run, of the cases of a sweep, and of a prepared run."""
    start, options = {x: KNOT, v: 0.0}, {"method": method, "inputs": inputs, **TIGHT}
    run = made.simulate(span, start, {m: 1.0}, **options)
    cases = made.sweep(span, start, {m: np.ones(count)}, **options)
    assert run.success and np.all(cases.success)
    found = [[run["x"][-1], run["x_dot"][-1]], *zip(cases["x"], cases["x_dot"], strict=True)]
    state = made.state(start, {m: 1.0}, inputs=None if inputs is None else {u: 0.0})
    go = made.prepare(span, **options)
    final = dict(zip(made.layout.state, go(state, made.parameter_vector({m: 1.0})), strict=True))
    assert go.status.success
    place, speed = (next(final[name] for name in names if name in final) for names in (("x", "y"), ("x_dot", "y_dot")))
    found.append([place - (0.25 if "y" in final else 0.0), speed])
    return np.array(found)


def check_traced_runs(made):
    """Compare the ends of traced runs by two methods, of one case and of two, with closed forms; the force is -1 N."""
    jax = pytest.importorskip("jax")
    with jax.enable_x64(True):
        for method in ("tsit5", "taylor"):
            solve = made.solve_fn(["x", "x_dot"], method=method, rtol=1e-10, atol=1e-12, max_steps=500)
            for given, (speed, way) in PULLS.values():

                def end(mass, given=given, solve=solve):
                    run = solve([0.0, 2.0], {"x": KNOT, "x_dot": 0.0}, {"m": mass}, inputs={"u": given})
                    return run.y[-1]

                expected = [KNOT + 0.25 + way - 0.5, speed - 1.0]
                assert end(1.0) == pytest.approx(expected, abs=1e-11)
                assert jax.vmap(end)(np.ones(2)) == pytest.approx(np.tile(expected, (2, 1)), abs=1e-11)
