"""Constraints whose coefficients vanish at the parameters of a run are named by the errors that they cause."""

import numpy as np
import pytest
from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import InitialStateError, ValueInputError
from dalembert.ir.interpret import interpret
from dalembert.methods.status import Status
from dalembert.starts.inputs import vanished_text

x, y = dynamicsymbols("x y")
m, k = symbols("m k")
START = {x: 0.6, y: 0.8, x.diff(): 0.0, y.diff(): 0.0}
NAMED = r"All coefficients of (non)?holonomic constraint 1, .* = 0 vanish at these parameters"


def constrained(formulation="auto", holonomic=(), nonholonomic=()):
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("bead", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("bead", O.locatenew("P", x * N.x + y * N.y), m))
    scene.add_holonomic_constraints(*holonomic)
    scene.add_nonholonomic_constraints(*nonholonomic)
    return da.compile_model(scene, formulation=formulation)


@pytest.mark.parametrize("given", [START, {y: 0.8, y.diff(): 0.0}])
def test_a_line_times_zero(given):
    with pytest.raises(InitialStateError, match=NAMED) as fault:
        constrained(holonomic=[k * (x - y)]).simulate((0, 1), given, {m: 1, k: 0})
    assert "small coefficient" not in str(fault.value)


def test_a_rate_times_zero():
    made = constrained(nonholonomic=[k * x.diff()])
    with pytest.raises(InitialStateError, match=NAMED):
        made.simulate((0, 1), {x: 0.6, y: 0.8, y.diff(): 0.0}, {m: 1, k: 0})


@pytest.mark.parametrize("formulation", ["auto", "projected"])
def test_a_circle_times_zero(formulation):
    made = constrained(formulation, [k * (x**2 + y**2 - 1)])
    with pytest.raises(ValueInputError, match=NAMED):
        made.simulate((0, 1), START, {m: 1, k: 0})
    assert made.simulate((0, 1), START, {m: 1, k: 2}).success


def test_other_zeros_have_other_errors():
    made = constrained("projected", [k * (x**2 + y**2 - 1)])
    with pytest.raises(ValueInputError, match="a mass, a length") as fault:
        made.simulate((0, 1), START, {m: 0, k: 1})
    assert "All coefficients" not in str(fault.value)


def test_several_constraints_are_named_together():
    made = constrained("projected", nonholonomic=[k * x.diff(), k * (x.diff() - y.diff())])
    program, values = made.stages.program, {"m": 1.0, "k": 0.0}
    p = [values.get(name, 0.0) for name in program.layout.parameters]
    text = vanished_text(program, np.array(interpret(program.kernel("prepare"), {"p": p})))
    assert "constraint 1" in text and "constraint 2" in text
    assert "they constrain nothing" in text and "remove the constraints" in text


def test_a_constraint_whose_derivatives_vanish_on_the_way_is_named_alone():
    """It was said to depend on others, with a smallest singular value of 1."""
    made = constrained("projected", [x**2 + dynamicsymbols._t - 1])
    run = made.simulate((0, 2), {x: 1.0, y: 0.0, y.diff(): 0.0}, {m: 1})
    assert run.status is Status.SINGULAR_CONFIGURATION and run.t_end == pytest.approx(1.0, abs=1e-6)
    assert "the derivatives of holonomic constraint 1," in run.message and "singular value" not in run.message
