"""Branches that meet at a singular configuration, named in the message of the run that ends there."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.methods.status import Status
from system.singular_scenes import windows

x, y, z = dynamicsymbols("x y z")
N, O = ReferenceFrame("N"), Point("O")
BARS = {"m": 1.0, "L": 1.0, "g": 9.81}


def bead(*constraints, speeds=()):
    scene = da.Scene("bead", frame=N, origin=O, coordinates=[x, y, z])
    scene.add_bodies(Particle("bead", O.locatenew("P", x * N.x + y * N.y + z * N.z), 1))
    scene.add_holonomic_constraints(*constraints)
    scene.add_nonholonomic_constraints(*speeds)
    return scene


def node(slope, size=1):
    """A curve that crosses itself at the origin with two slopes."""
    return y**2 - slope**2 * x**2 * (1 + x / (3 * size))


def crossing(scene, size=1.0, slope=0.7, formulation="augmented"):
    model = da.compile_model(scene, formulation=formulation)
    start = {"x": size, "y": slope * np.sqrt(4 / 3) * size, "z": 0, "x_dot": -size}
    return model.simulate((0, 3), start, {}, rtol=1e-9, atol=1e-11 * size)


@pytest.mark.parametrize("formulation", ["augmented", "baumgarte"])
def test_a_curve_that_crosses_itself(formulation):
    run = crossing(bead(node(sp.Rational(7, 10)), z), formulation=formulation)
    assert run.status is Status.SINGULAR_CONFIGURATION
    assert "; 2 branches meet there: (y_dot = 0.7 x_dot), or (y_dot = -0.7 x_dot)" in run.message


@pytest.mark.parametrize("size", [1e-6, 1e5])
def test_any_unit_of_length(size):
    run = crossing(bead(node(sp.Rational(2, 5), sp.Float(size)), z), size, 0.4)
    assert "2 branches meet there: (y_dot = 0.4 x_dot), or (y_dot = -0.4 x_dot)" in run.message


def test_two_branches_of_a_cone_cut_by_a_surface_and_none_of_the_cone_alone():
    """A surface through the tip of a cone meets it in two curves; the cone alone has a continuum of directions."""
    cone = x**2 * (1 + x / 3) - y**2 - 4 * z**2
    model = da.compile_model(bead(cone, z * (1 + x / 5) - y / 2), formulation="augmented")
    start = model.assemble({"x": 1.0, "y": 0.8, "z": 0.3}, {}, fixed=["x"])
    run = model.simulate((0, 3), {**start, "x_dot": -1.0}, {})
    slope = 1 / np.sqrt(2)
    assert run.status is Status.SINGULAR_CONFIGURATION
    assert f"(y_dot = {slope:.4g} x_dot, z_dot = {slope / 2:.4g} x_dot), or (y_dot = -{slope:.4g} x_dot" in run.message
    alone = da.compile_model(bead(cone), formulation="augmented")
    through = {"x": 1.0, "y": np.sqrt(4 / 3), "z": 0.0, "x_dot": -1.0, "z_dot": 0.0}
    ended = alone.simulate((0, 3), through, {})
    assert ended.status is Status.SINGULAR_CONFIGURATION and "branches" not in ended.message


@pytest.mark.parametrize("count", [1, 2, 3])
def test_parallel_bars(count):
    """With cranks at pi/2 + s_i, the loops are s_0 (s_0 - s_1) = 0, s_1 (s_1 - s_2) = 0 ... to second order, by hand.

    So all cranks turn together, or the first few rest, and the bar after them turns against the others.
    """
    model = da.compile_model(windows(count), formulation="augmented")
    start = dict.fromkeys([f"a{i}" for i in range(count + 1)], 0.0) | dict.fromkeys(
        [f"b{i}" for i in range(count)], 0.0
    )
    run = model.simulate((0, 2), {**start, "a0_dot": 1.0}, BARS)
    assert run.status is Status.SINGULAR_CONFIGURATION
    branches = []
    for still in range(count + 1):
        turning = [f"a{i}_dot = {'0' if i < still else f'a{count}_dot'}" for i in range(count)]
        bars = [f"b{i}_dot = {f'-a{count}_dot' if i == still - 1 else '0'}" for i in range(count)]
        branches.append(set(turning + bars))
    text = run.message.split("branches meet there: ")[1]
    found = [set(each.strip("().").split(", ")) for each in text.split(", or ")]
    assert f"{count + 1} branches meet there" in run.message and found[0] == branches[0]
    assert all(each in found for each in branches) and len(found) == len(branches)


def test_a_run_that_would_start_there_names_them():
    model = da.compile_model(bead(node(sp.Rational(7, 10)), z), formulation="augmented")
    run = model.simulate((0, 1), {"x": 0, "y": 0, "z": 0, "x_dot": 1.0, "y_dot": -0.7}, {})
    assert run.status is Status.SINGULAR_CONFIGURATION
    assert "start elsewhere" in run.message and "(y_dot = -0.7 x_dot), or (y_dot = 0.7 x_dot)" in run.message


@pytest.mark.parametrize("more", ["time", "rates"])
def test_constraints_of_time_or_rates_have_no_branches_named(more):
    T = dynamicsymbols._t
    scene = (
        bead(node(sp.Rational(7, 10)), z - T) if more == "time" else bead(node(sp.Rational(7, 10)), speeds=[z.diff()])
    )
    run = crossing(scene)
    assert run.status is Status.SINGULAR_CONFIGURATION and "branches meet" not in run.message


def test_events_of_a_run_that_cannot_start_are_listed():
    model = da.compile_model(bead(node(sp.Rational(7, 10)), z), formulation="augmented")
    start = {"x": 0, "y": 0, "z": 0, "x_dot": 0, "y_dot": 0, "z_dot": 0}
    run = model.simulate((0, 1), start, {}, events=[da.Event(x - 1, name="far")])
    assert run.status is Status.SINGULAR_CONFIGURATION
    assert len(run.events["far"]) == 0
