"""Taylor runs pass singular positions on the branch that continues the motion, and turn where it turns beside one."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.methods.status import Status
from hard_cases import hard_case
from system.singular_scenes import folding_crank, unequal_window, windows

BARS = {"m": 1.0, "L": 1.0, "g": 9.81}
SPEEDS = np.random.default_rng(35).uniform(0.8, 2.0, 12)
END = 20.0
"""Some forty singular positions of each run."""


@cache
def model_of(count):
    """Return a mechanism of so many windows, upright at the start, `projected`."""
    return da.compile_model(windows(count), formulation="projected", outputs=("energy",))


def start(count, speed):
    """Return upright cranks that turn; the bars between their tips stay level."""
    angles = [f"a{i}" for i in range(count + 1)] + [f"b{i}" for i in range(count)]
    return dict.fromkeys(angles, 0.0) | {"a0_dot": speed}


@cache
def angle_of(count, speed):
    """Return the angle of the cranks at the end: all cranks are one pendulum."""
    load, inertia = (count + 1) / 2 + count, (count + 1) / 3 + count

    def rates(_, y):
        return [y[1], 9.81 * load / inertia * np.sin(y[0])]

    return solve_ivp(rates, (0, END), [0.0, speed], "DOP853", rtol=1e-13, atol=1e-14).y[0, -1]


def energy_of(count, speed):
    """Return the energy of upright cranks."""
    return 9.81 * ((count + 1) / 2 + count) + 0.5 * ((count + 1) / 3 + count) * speed**2


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-10, 1e-12, 1e-13])
def test_single_runs_pass_all_of_them(count, rtol):
    """Rounding moves velocities by 1/d^2 at a distance d: no step ends close to a singular position."""
    for speed in SPEEDS[:4]:
        options = {"method": "taylor", "rtol": rtol, "atol": rtol / 100}
        run = model_of(count).simulate((0, END), start(count, speed), BARS, **options)
        assert run.success, run.message
        assert np.ptp(run["energy"]) < max(30 * rtol, 1e-12) * energy_of(count, speed)
        assert np.ptp(run.q[:, : count + 1], axis=1) == pytest.approx(0.0, abs=1e-12)
        assert run["a0"][-1] == pytest.approx(angle_of(count, speed), abs=1e4 * max(rtol, 1e-12))


@pytest.mark.parametrize("rtol", [1e-10, 1e-12])
def test_the_published_benchmark_through_its_singular_positions(rtol):
    """IFToMM A02, two windows, 10 s: the reference of elliptic functions, without the windows."""
    case = hard_case("four-bar through its singular position")
    run = case.simulate(case.compile("projected"), method="taylor", rtol=rtol, atol=rtol / 100, all_of_them=True)
    assert run.success, run.message
    assert case.error(run) < 10 * max(rtol, 1e-12)


@pytest.mark.parametrize("rtol", [1e-8, 1e-12])
def test_cases_of_sweeps_pass_as_single_runs_do(rtol):
    sweep = model_of(1).sweep((0, END), start(1, SPEEDS), BARS, method="taylor", rtol=rtol, atol=rtol / 100)
    assert np.all(sweep.success), sweep.status
    np.testing.assert_allclose(sweep.final["energy"], energy_of(1, SPEEDS), rtol=max(100 * rtol, 1e-12))


@pytest.mark.parametrize("count", [1, 3])
def test_automatic_runs_whose_pair_cannot_pass_are_repeated_by_taylor(count):
    tight = {"rtol": 1e-11, "atol": 1e-13}
    pair = model_of(count).simulate((0, END), start(count, 1.3), BARS, method="dop853", **tight)
    if count == 1 and pair.success:  # rounding decides, which differs with the processor
        assert np.ptp(pair["energy"]) < 1e-9 * energy_of(count, 1.3)
    else:
        assert pair.status is Status.SINGULAR_CONFIGURATION
        assert 'use method="taylor"' in pair.message
    run = model_of(count).simulate((0, END), start(count, 1.3), BARS, **tight)
    assert run.success
    assert run.stats.method == "taylor" or pair.success
    assert np.ptp(run["energy"]) < 1e-9 * energy_of(count, 1.3)


@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-12])
def test_folding_cranks_in_sweeps_all_pass(rtol):
    """A row of the guide vanishes at each fold; starts draw near it from both sides."""
    model = da.compile_model(folding_crank(), formulation="projected", outputs=("energy",))
    angles, length = np.random.default_rng(1).uniform(0.3, 1.2, 200), 0.3
    initial = {"a": angles, "b": -angles, "x": 2 * length * np.cos(angles), "a_dot": np.full(200, 5.0)}
    parameters = {"m": 1.0, "M": 2.0, "L": length, "g": 9.81}
    options = {"method": "taylor", "rtol": rtol, "atol": rtol / 100, "t_eval": [0, 3]}
    sweep = model.sweep((0, 3), initial, parameters, **options)
    assert np.all(sweep.success)
    assert np.max(np.ptp(sweep["energy"], axis=1)) < 300 * max(rtol, 1e-13) * 20
    np.testing.assert_allclose(np.sin((sweep.final["a"] + sweep.final["b"]) / 2), 0.0, atol=1e-9)


def test_guards_of_pivots_do_not_control_steps():
    """A comparison that only guards a pivot hides nothing of the motion from its series."""
    model = model_of(1)
    assert "taylor" in model.explain()
    library = model.engine.steps
    assert library.passes_lost_ranks(15)
    assert not library.nonsmooth
    assert library.control(15) == (0, 0)


@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-10, 1e-12])
@pytest.mark.parametrize("longer", [1e-5, 1e-7, 1e-9])
def test_a_bar_that_is_a_little_longer_turns_over(longer, rtol):
    """Cranks that nearly lie down turn in opposite directions, within sqrt(longer) of an angle."""
    model = da.compile_model(unequal_window(), formulation="projected", outputs=("energy",))
    parameters = BARS | {"D": longer}
    given = model.assemble({"a0": 0.0, "a1": 0.0, "b0": 0.0}, parameters, fixed=["a0"])
    options = {"method": "taylor", "rtol": rtol, "atol": rtol / 100}
    run = model.simulate((0, 1.2), {**given, "a0_dot": 1.0}, parameters, **options)
    assert run.success
    assert run["a1"][-1] - run["a0"][-1] > 3.0
    assert np.ptp(run["energy"]) < 1e3 * max(rtol, 1e-13) * energy_of(1, 1.0)


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_reactions_that_grow_towards_a_singular_position(method):
    """A particle on the line x = z = 0 is held by z = 0 and z = x y against a push F along x: the reaction is F/|y|."""
    x, y, z = dynamicsymbols("x y z")
    N, O = ReferenceFrame("N"), Point("O")
    floor, roof = da.unknowns("floor roof")
    P = O.locatenew("P", x * N.x + y * N.y + z * N.z)
    scene = da.Scene("wedge", frame=N, origin=O, coordinates=[x, y, z])
    scene.add_bodies(Particle("p", P, 1))
    scene.add_loads((P, sp.Symbol("F") * N.x))
    scene.add_joints(da.Joint("floor", body="p", at=P, force=floor * N.z))
    scene.add_joints(da.Joint("roof", body="p", at=P, force=roof * (y * N.x + x * N.y - N.z)))
    scene.add_holonomic_constraints(z, x * y - z)
    model = da.compile_model(scene, formulation="projected", outputs=["roof", "floor"])
    for left, rtol in ((1e-2, 1e-9), (1e-3, 1e-8), (1e-4, 1e-7), (1e-5, 1e-6)):
        run = model.simulate((0.0, 1.0 - left), {"x": 0, "y": -1.0, "y_dot": 1.0}, {"F": 3.0}, method=method)
        assert run.success
        assert run["roof"][-1] == pytest.approx(3.0 / left, rel=rtol)
        assert run["floor"][-1] == pytest.approx(run["roof"][-1], rel=rtol)
