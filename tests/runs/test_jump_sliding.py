"""Runs that use up their steps where a force jumps say so, and others do not."""

import re

import pytest
from sympy import Heaviside, Piecewise, sign, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.methods.status import Status

x, m = dynamicsymbols("x"), symbols("m", positive=True)
N, O = ReferenceFrame("N"), Point("O")
SURFACE = x + x.diff()
"""Motions that are pushed back to where it vanishes slide along it, as exp(-t)."""


def pushed(law):
    scene = da.Scene("pushed", frame=N, origin=O, coordinates=[x])
    P = O.locatenew("P", x * N.x)
    scene.add_bodies(Particle("body", P, m))
    scene.add_loads((P, -2 * law * N.x))
    return da.compile_model(scene, backend="numpy", cache=False)


def run(law, **options):
    return pushed(law).simulate((0, 30), {x: 1, x.diff(): 0}, {m: 1}, **{"max_steps": 200, **options})


LAWS = {
    r"sign\(x \+ .*\)": sign(SURFACE),
    r"the condition x \+ .* > 0": Piecewise((1, SURFACE > 0), (-1, True)),
    r"Heaviside\(x \+ .*\)": 2 * Heaviside(SURFACE) - 1,
    "the table 'relay'": da.table(SURFACE, [-1, 0, 1], [-1, 1, 1], kind="hold", extrapolate="hold", name="relay"),
}


@pytest.mark.parametrize("name", LAWS)
def test_a_jump_that_the_motion_slides_along_is_named(name):
    ended = run(LAWS[name])
    assert ended.status is Status.MAX_STEPS and 0.3 < ended.t_end < 1.0
    said = rf"the last 100 steps, .* s, stay where {name} changes: the motion slides"
    assert re.search(said, ended.message)


def test_it_is_named_in_a_run_with_times_to_record():
    assert "the motion slides along this jump" in run(sign(SURFACE), t_eval=[0, 10, 20]).message


@pytest.mark.parametrize("law", [x, sign(x), 1000 * x + sign(x.diff() + 5)])
def test_a_run_that_needs_more_steps_for_other_reasons_names_none(law):
    ended = run(law, max_steps=110, rtol=1e-12, atol=1e-14)
    assert ended.status is Status.MAX_STEPS and "slides" not in ended.message
