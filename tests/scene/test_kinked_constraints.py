"""Constraints and positions whose velocities would jump somewhere: refused by name; smooth ones with switches not."""

import numpy as np
import pytest
from sympy import (
    Abs,
    Heaviside,
    Max,
    Min,
    Piecewise,
    Rational,
    acos,
    asin,
    atan,
    atan2,
    cos,
    exp,
    floor,
    sign,
    sin,
    sqrt,
    symbols,
)
from sympy.physics.mechanics import LagrangesMethod, Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import CapabilityError, SceneError
from dalembert.methods.status import Status

x, y = dynamicsymbols("x y")
m, k, L = symbols("m k L", positive=True)
TIME = dynamicsymbols._t


def compiled(holonomic=(), nonholonomic=()):
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("bead", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("bead", O.locatenew("P", x * N.x + y * N.y), m))
    scene.add_holonomic_constraints(*holonomic)
    scene.add_nonholonomic_constraints(*nonholonomic)
    return da.compile_model(scene)


@pytest.mark.parametrize(
    ("constraint", "what"),
    [
        (Abs(x) - y, "Abs"),
        (Abs(x - 1000 * L) - y, "Abs"),
        (Abs(cos(x)) - y, "Abs"),
        (Max(x, L) - y, "Max"),
        (Min(k * x, L) - y, "Min"),
        (Piecewise((x**2, x < 1), (3 * x - 2, True)) - y, "a condition"),
        (sign(x) - y, "sign"),
        (floor(x) - y, "floor"),
        (sqrt(x**2) - y, "the root of a square"),
        (sqrt((x - L) ** 2 * y**2) - k, "the root of a square"),
        (sqrt(3 * (x - y) ** 2) - L, "the root of a square"),
    ],
)
def test_holonomic_constraints_with_a_kink_are_refused(constraint, what):
    with pytest.raises(SceneError, match=rf"holonomic constraint 1, .* = 0: its gradient jumps .* of {what} in"):
        compiled([constraint])


@pytest.mark.parametrize("coefficient", [sign(x), Heaviside(x - L), Piecewise((1, x < L), (2, True))])
def test_nonholonomic_constraints_whose_coefficients_jump_are_refused(coefficient):
    with pytest.raises(SceneError, match=r"nonholonomic constraint 1, .* = 0: its coefficients jump"):
        compiled(nonholonomic=[coefficient * y.diff() - x.diff()])


@pytest.mark.parametrize(
    "constraint",
    [
        x * Abs(x) - y,
        Abs(x) ** 3 - y,
        Max(0, x) ** 2 - y,
        Abs(x**2 + 1) - y,
        sqrt(x**4) - y,
        sqrt(x**6) - y,
        sqrt(x**2 + y**2) - L,
        atan2(x, y) - L,
        exp(x**2 / 2) + sqrt(atan(y)) - L,  # of infinite values far away, which warn of nothing
        Piecewise((x**2, x < 1), (2 * x - 1, True)) - y,
        y - Max(0, TIME - 1),
    ],
)
def test_smooth_constraints_and_kinks_in_time_are_compiled(constraint):
    assert compiled([constraint]).layout.holonomic == 1


def test_continuous_coefficients_are_compiled():
    assert compiled(nonholonomic=[Abs(x) * y.diff() - x.diff()]).layout.constraints


a = dynamicsymbols("a")
r = symbols("r", positive=True)
HIDDEN = sqrt(1 - cos(a) ** 2)
"""The absolute value of sin(a), without one."""


def bead_on_wire(height, turn=0):
    """A bead on a wire (x, 0, height); a rod on it is turned about the vertical."""
    N, O = ReferenceFrame("N"), Point("O")
    B, P = N.orientnew("B", "Axis", (turn, N.z)), O.locatenew("P", x * N.x + height * N.z)
    scene = da.Scene("wire", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(RigidBody("bead", P, B, m, (inertia(B, k, k, k), P)))
    return scene, B, P


def disc(height, coordinates=(), angles="XYZ"):
    """A disc whose mass centre has a height; three angles turn it, or the first alone."""
    N, O = ReferenceFrame("N"), Point("O")
    turns = (a, *dynamicsymbols("b c"))[: len(angles)]
    B, axes = N, dict(zip("XYZ", "xyz", strict=True))
    for i, (letter, angle) in enumerate(zip(angles, turns, strict=True)):
        B = B.orientnew(f"B{i}", "Axis", (angle, getattr(B, axes[letter])))
    P = O.locatenew("P", height * N.z)
    scene = da.Scene("disc", frame=N, origin=O, coordinates=[*turns, *coordinates])
    scene.add_bodies(RigidBody("disc", P, B, m, (inertia(B, k, k, 2 * k), P)))
    scene.apply_uniform_gravity(-N.z)
    return scene


@pytest.mark.parametrize(
    ("height", "what"),
    [
        (Abs(x) + x / 2, "Abs"),
        (Max(x, -2 * x), "Max"),
        (Piecewise((x, x > 0), (-2 * x, True)), "a condition"),
        (sqrt((x - L) ** 2), "the root of a square"),
        (sqrt(2 - 2 * cos(x)), "the root of a square"),
        (L * cos(x) + sqrt(L**2 - L**2 * sin(x) ** 2), "the root of a square"),
        (acos(cos(x)), "acos"),
        (asin(sin(x)), "asin"),
        ((x**4) ** Rational(1, 4), "a power"),
        (atan(L / x), "atan"),
    ],
)
def test_positions_with_a_kink_are_refused(height, what):
    """The speed of the coordinate stayed as it was at the kink, and the energy did not, with SUCCESS."""
    with pytest.raises(SceneError, match=rf"the position of point 'P': its gradient jumps .* of {what} in"):
        da.compile_model(bead_on_wire(height)[0])


def test_orientations_with_a_kink_are_refused():
    for turn, what in ((Abs(x) + x / 2, "Abs"), (sqrt(2 - 2 * cos(x)), "the root of a square")):
        with pytest.raises(SceneError, match=rf"the orientation of frame 'B': its gradient jumps .* of {what} in"):
            da.compile_model(bead_on_wire(0, turn)[0])
    assert da.compile_model(bead_on_wire(0, x * Abs(x))[0]).layout.state


def test_the_momenta_of_a_lagrangian_must_not_jump():
    for given in (Abs(x) * x.diff() ** 2, sign(x - L) * x.diff()):
        with pytest.raises(SceneError, match="the Lagrangian: its coefficients jump at a kink or a jump of sign in"):
            da.compile_model(LagrangesMethod(x.diff() ** 2 + sign(x) * given / Abs(x), [x]))
    assert da.compile_model(LagrangesMethod(x.diff() ** 2 - Abs(x), [x])).layout.state


@pytest.mark.parametrize(
    "height",
    [
        x * Abs(x),
        Max(0, x) ** 2,
        sqrt(x**4),
        sqrt(x**2 + L**2),
        L * cos(x) + sqrt(k**2 - L**2 * sin(x) ** 2),
        asin(L * sin(x) / k),
        acos(x / L),
        (x**2) ** Rational(3, 2),
        atan(x / L),
    ],
)
def test_smooth_positions_with_switches_are_compiled(height):
    assert da.compile_model(bead_on_wire(height, height)[0]).layout.state


def test_points_without_mass_may_have_kinks():
    scene, B, P = bead_on_wire(0)
    lowest = P.locatenew("lowest", Abs(sin(x)) * B.x)
    scene.add_loads(("bead", lowest, -B.z))
    assert da.compile_model(scene, outputs=[lowest]).layout.state


@pytest.mark.parametrize("way", ["position", "constraint"])
def test_a_hidden_square_is_refused_where_no_angles_lock(way):
    """A disc that leans and falls flat came up again, as fast as it had fallen, with SUCCESS."""
    z = dynamicsymbols("z")
    for angles in ("X", "XYZ"):  # those of the second lock where the second angle is a right one
        scene = disc(r * HIDDEN, angles=angles) if way == "position" else disc(z, [z], angles)
        if way == "constraint":
            scene.add_holonomic_constraints(z - r * HIDDEN)
        with pytest.raises(SceneError, match="its gradient jumps at a kink or a jump of the root of a square"):
            da.compile_model(scene)


def locking_disc(way):
    """A disc whose height is the root of a hidden square, which vanishes where its angles lock, and how it falls."""
    b, z = dynamicsymbols("b z")
    height = r * HIDDEN.subs(a, b)
    scene = disc(height, angles="ZXZ") if way == "position" else disc(z, [z], "ZXZ")
    if way == "constraint":
        scene.add_holonomic_constraints(z - height)
    start = {a: 0.0, b: 0.5, "c": 0.0, "a_dot": 0.0, "b_dot": -1.0, "c_dot": 0.0}
    return scene, start, {m: 1.0, k: 0.25, r: 1.0}


@pytest.mark.parametrize("way", ["position", "constraint"])
def test_a_hidden_square_ends_runs_where_its_angles_lock(way):
    """Within 6 s it passes the lock twice, so that no sign tells a sweep of it."""
    scene, start, p = locking_disc(way)
    model = da.compile_model(scene)
    y = model.state(start, p)
    for method in ("taylor", "dop853", "radau"):
        run = model.simulate((0, 6), start, p, method=method)
        assert run.status is Status.SINGULAR_COORDINATES and 0.44 < run.t[-1] < 0.45, method
        sweep = model.sweep((0, 6), {**start, "b_dot": np.array([-1.0, -1.0, 9.0])}, p, method=method, t_eval=[0.4, 6])
        assert sweep.status.tolist()[:2] == [Status.SINGULAR_COORDINATES] * 2
        assert sweep.t[0] == run.t[-1] and sweep["b"][0, 0] > 0.0 and np.isnan(sweep["b"][0, 1])
        assert model.sweep((0, 0.4), start, p, method=method).success
        prepared = model.prepare((0.0, 6.0), method=method)
        prepared(y, model.parameter_vector(p))
        assert prepared.status is Status.SINGULAR_COORDINATES


def test_solve_fn_refuses_kinks_where_angles_lock():
    pytest.importorskip("jax")
    model = da.compile_model(locking_disc("position")[0], backend="jax")
    with pytest.raises(CapabilityError, match="solve_fn does not see the attitudes at which angles lock"):
        model.solve_fn()
