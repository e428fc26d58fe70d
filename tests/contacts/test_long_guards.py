"""Guards of many contacts: rounding errors by slopes along directions, and slip in a plane that begins."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen.llvm import backend
from dalembert.reduction import event_functions as functions
from dalembert.runs import events
from hard_cases.many_contacts import feet, feet_at_rest, legged, legged_at_rest, turning, turning_at_rest

TIME = dynamicsymbols._t


@pytest.fixture
def in_parts(monkeypatch):
    """Return a function after whose call no guard is short enough to be written out."""

    def begin():
        monkeypatch.setattr(functions, "_LONGEST", 0)
        monkeypatch.setattr(backend, "LARGEST_INLINED", 0)

    return begin


@pytest.mark.matrix
@pytest.mark.parametrize("make, about", [(lambda: feet(4), feet_at_rest(4)), (turning, turning_at_rest())])
@pytest.mark.parametrize("method", ["dop853", "taylor"])
def test_phases_are_the_same_by_slopes_along_directions_and_by_all_derivatives(in_parts, make, about, method):
    scene, (start, p) = make(), about
    run = da.compile_model(scene, cache=False).simulate((0, 0.5), start, p, method=method)
    in_parts()
    again = da.compile_model(scene, cache=False).simulate((0, 0.5), start, p, method=method)
    assert len(run.phases) > 3
    assert [phase.modes for phase in again.phases] == [phase.modes for phase in run.phases]
    assert [phase.t0 for phase in again.phases] == pytest.approx([phase.t0 for phase in run.phases], abs=1e-11)
    assert again.q[-1] == pytest.approx(run.q[-1], abs=1e-10)


@pytest.mark.matrix
def test_guards_of_a_robot_are_a_small_multiple_of_their_values(monkeypatch):
    made, own = [], events.event_functions
    monkeypatch.setattr(events, "event_functions", lambda *a, **k: made.append(own(*a, **k)) or made[-1])
    start, p = legged_at_rest(1)
    da.compile_model(legged(1), cache=False).simulate((0, 0.004), start, p)
    long = [each for each in made if each.slopes is not None]
    assert long
    for each in long:
        assert len(each.slopes.kernel.body) < 4 * len(each.values.body)
        assert len(each.begins.body) < 2 * len(each.values.body)


def block(force):
    """Return a block on a rough floor that a force along it pushes."""
    N, O, place = ReferenceFrame("N"), Point("O"), dynamicsymbols("x y z")
    scene = da.Scene("block", frame=N, origin=O, coordinates=place)
    P = O.locatenew("P", sum((q * axis for q, axis in zip(place, N, strict=True)), 0 * N.x))
    scene.add_bodies(Particle("block", P, 1))
    scene.apply_uniform_gravity(-10 * N.z)
    scene.add_loads((P, force[0] * N.x + force[1] * N.y))
    scene.add_contacts(da.PointPlane("floor", body="block", point=P, plane=(O, N.z), friction=sp.Rational(1, 2)))
    rest = dict.fromkeys([name + end for name in "xyz" for end in ("", "_dot")], 0)
    return da.compile_model(scene), rest


@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
def test_slip_on_a_curve_begins_along_the_force_and_turns_with_it(rtol):
    # (3 + 3 s, 4 + 2 s) for s = t - 1 reaches the friction of 5 N at s = 0, and grows along (3, 4)/5 by 3.4 N/s. With
    # friction along the slip w, w = 1.7 s^2 (3, 4)/5, and across it w turns by s/2 * (the rate across)/5 per s.
    model, rest = block((3 + 3 * (TIME - 1), 4 + 2 * (TIME - 1)))
    run = model.simulate((0.5, 1.5), rest, {}, rtol=rtol, atol=rtol / 100)
    assert run.success
    assert run.phases[1].t0 == pytest.approx(1, abs=1e-12)
    along, across = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    growth, turning = along @ [3, 2], across @ [3, 2]
    for s in (0.02, 0.05):
        at = run(1 + s)
        w = np.array([at["x_dot"], at["y_dot"]])
        assert along @ w == pytest.approx(growth * s**2 / 2, rel=0.05 * s)
        assert (across @ w) / (along @ w) == pytest.approx(turning * s / 5, rel=1.2 * s)


def test_slip_that_begins_slowly_takes_few_steps_whatever_its_direction():
    model, rest = block((3 + 3 * (TIME - 1), 4 + 2 * (TIME - 1)))
    run = model.simulate((0.5, 1.5), rest, {}, rtol=1e-9, atol=1e-11)
    fine = model.simulate((0.5, 1.5), rest, {}, rtol=1e-11, atol=1e-13)
    begins = run.phases[1]
    assert begins.modes == {"floor": "slip"}
    assert np.sum((run.t > begins.t0) & (run.t <= begins.t1)) < 40
    assert run.q[-1] == pytest.approx(fine.q[-1], abs=1e-9)
