"""Events whose maps stop a body where it is: it stays there, and its event does not occur again by rounding."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.methods.status import Status

x, y, z = dynamicsymbols("x y z")
STILL = {x.diff(): 0, y.diff(): 0, z.diff(): 0}


def springs(centre, floor, backend="llvm"):
    """Return a particle at springs, whose force along x vanishes at a centre, possibly above a floor."""
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y + z * N.z)
    scene = da.Scene("springs", frame=N, origin=O, coordinates=[x, y, z])
    scene.add_bodies(Particle("particle", P, 1))
    scene.add_loads((P, -43 * (x - centre) * N.x - 22 * y * N.y))
    if floor:
        scene.add_contacts(da.PointPlane("floor", body="particle", point=P, plane=(O, N.z), restitution=0))
    return da.compile_model(scene, backend=backend)


START = {"x_dot": 0.1, "y": 0.2, "y_dot": 0.0, "z": 1.0, "z_dot": 0.0}


@pytest.mark.parametrize(
    ("centre", "floor", "backend"),
    [(0, False, "llvm"), (0, True, "llvm"), (sp.Rational(3, 10), False, "llvm"), (0, False, "numpy")],
)
def test_a_body_that_is_stopped_where_no_force_acts_stays_there(centre, floor, backend):
    model, level = springs(centre, floor, backend), float(centre)
    stop = da.Event(x - level, direction=-1, apply=STILL, name="stop")
    for rtol in (1e-6, 1e-8):
        run = model.simulate((0, 5), START | {"x": level + 0.31}, {}, rtol=rtol, atol=1e-2 * rtol, events=[stop])
        assert run.status is Status.SUCCESS and len(run.events["stop"]) == 1
        assert run["x"][-1] == level and run["x_dot"][-1] == 0.0
    begun = run.events["stop"].t[0], run.events["stop"].after["y"][0]
    assert run["y"][-1] == pytest.approx(begun[1] * np.cos(np.sqrt(22) * (5 - begun[0])), abs=1e-6)


def test_a_coordinate_that_another_map_moves_is_not_taken_back():
    """Both events occur at one instant; the first moves the particle by 1."""
    model = springs(0, False)
    away = da.Event(x, direction=-1, apply={x: 1}, name="away")
    stop = da.Event(2 * x, direction=-1, apply={y.diff(): 0}, name="stop")
    run = model.simulate((0, 0.3), START | {"x": 0.31}, {}, events=[away, stop])
    assert len(run.events["away"]) == len(run.events["stop"]) == 1
    assert run.events["away"].after["x"][0] == 1.0 and run["x"][-1] > 0.5
