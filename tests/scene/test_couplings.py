"""Rods, ropes and gears against closed forms, and their faults."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import OptionError, SceneError

m, M, g, l, n, tau = sp.symbols("m M g l n tau", positive=True)
N, O = ReferenceFrame("N"), Point("O")


def particles(*masses):
    """Return a scene of particles in a plane, and their points."""
    coordinates = dynamicsymbols(f"x:{len(masses)} y:{len(masses)}")
    scene, points = da.Scene("particles", frame=N, origin=O, coordinates=coordinates), []
    for i, mass in enumerate(masses):
        x, y = coordinates[i], coordinates[i + len(masses)]
        points.append(O.locatenew(f"P{i}", x * N.x + y * N.y))
        scene.add_bodies(Particle(f"p{i}", points[-1], mass))
    return scene, points


def compiled(scene, outputs):
    return da.compile_model(scene, outputs=outputs, backend="numpy", cache=False)


# -- rods -----------------------------------------------------------------------------------------------


def test_a_dumbbell_that_spins():
    """Its tension is that of the reduced mass, m M / (m + M) l omega^2."""
    scene, (P, Q) = particles(m, M)
    rod = da.Rod(P, Q, name="bar", parent="p0", child="p1", length=l)
    scene.add_joints(rod)
    scene.add_shapes({"bar": rod})
    model = compiled(scene, ["bar.force", "bar.force_x"])
    start = {"x0": 0, "y0": 0, "x1": 0.5, "y1": 0, "x0_dot": 0.1, "y0_dot": 0, "y1_dot": 2.0}
    run = model.simulate((0, 1), start, {m: 1.0, M: 3.0, l: 0.5}, rtol=1e-11, atol=1e-12, t_eval=[0, 0.3, 1])
    assert run["bar.force"] == pytest.approx(0.75 * 0.5 * 4.0**2, abs=1e-8)
    along = (run["x1"] - run["x0"]) / 0.5
    assert run["bar.force_x"] == pytest.approx(-6.0 * along, abs=1e-8)
    assert "joint         bar: distance between 'p0' and 'p1': 1 holonomic constraint" in model.explain()


def test_a_rod_that_is_a_picture_alone():
    scene, (P,) = particles(m)
    with pytest.raises(SceneError) as caught:
        scene.add_joints(da.Rod(O, P))
    for name in ("name", "child", "length"):
        assert f"a rod that holds needs {name}=" in str(caught.value)


# -- ropes ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def rope():
    scene, (P,) = particles(m)
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_joints(da.Rope("string", None, "p0", parent_point=O, child_point=P, length=l))
    return scene, compiled(scene, ["string.force"])


def test_a_ball_that_falls_into_its_rope(rope):
    """It falls freely to the length, loses its speed along the rope, and swings with the tension of a pendulum."""
    _, model = rope
    run = model.simulate((0, 1), {"x0": 0.3, "y0": 0, "x0_dot": 0, "y0_dot": 0}, {m: 2, g: 10, l: 1}, rtol=1e-11)
    depth = np.sqrt(1 - 0.3**2)
    taut = np.sqrt(depth / 5)
    assert [phase.modes["string"] for phase in run.phases] == ["open", "closed"]
    assert run.phases[1].t0 == pytest.approx(taut, abs=1e-10)
    swinging = run.t > taut + 1e-9
    x, y = run["x0"][swinging], run["y0"][swinging]
    before = np.array([0, -10 * taut])
    across = np.array([depth, 0.3])  # unit vector across the rope where it becomes taut
    energy = (before @ across) ** 2 / 2 - 10 * depth
    square = 2 * (energy - 10 * y)
    assert np.hypot(x, y) == pytest.approx(1, abs=1e-9)
    assert run["string.force"][swinging] == pytest.approx(2 * (square - 10 * y), abs=1e-7)
    assert not run["string.force"][run.t < taut - 1e-9].any()


def test_a_slack_rope_of_no_length_at_all(rope):
    """The ball passes its anchor, where a rope has no direction."""
    _, model = rope
    run = model.simulate((0, 0.2), {"x0": 0, "y0": 0.1, "x0_dot": 0, "y0_dot": 0}, {m: 2, g: 10, l: 1}, rtol=1e-10)
    assert run.success and run["y0"][-1] == pytest.approx(0.1 - 0.2, abs=1e-10)


# -- gears ----------------------------------------------------------------------------------------------

Ia, Ib, Ic = sp.symbols("I_a I_b I_c", positive=True)
GEARED = {Ia: 0.3, Ib: 0.2, n: 3.0, tau: 1.5}


def shafts(*moments):
    """Return a scene of shafts about N.z, driven at the first, and their angles."""
    angles = dynamicsymbols("a b c")[: len(moments)]
    scene = da.Scene("shafts", frame=N, origin=O, coordinates=angles)
    for angle, moment in zip(angles, moments, strict=True):
        A = N.orientnew(angle.func.__name__.upper(), "Axis", (angle, N.z))
        scene.add_bodies(RigidBody(A.name, O, A, 1, (inertia(A, 0, 0, moment), O)))
    scene.add_loads((scene.bodies[0].frame, tau * N.z))
    return scene, angles


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("by_angles", [False, True])
def test_two_shafts(sense, by_angles):
    """The motor feels I_a + n^2 I_b."""
    scene, (a, b) = shafts(Ia, Ib)
    angles = (a, b) if by_angles else None
    scene.add_joints(da.Gear("gear", "A", "B", axis=N.z, ratio=sense * n, angles=angles))
    run = compiled(scene, ["gear.torque"]).simulate((0, 1), {"a": 0, "b": 0, "a_dot": 0}, GEARED, rtol=1e-10)
    rate = 1.5 / (0.3 + 9 * 0.2)
    assert run["gear.torque"] == pytest.approx(0.2 * sense * 3 * rate, abs=1e-12)
    assert run["b"][-1] == pytest.approx(sense * 3 * rate / 2, abs=1e-9)


def test_a_housing_that_turns():
    """A differential: b = c + n (a - c). Accelerations by Lagrange's equations in a and c, by hand."""
    scene, _ = shafts(Ia, Ib, Ic)
    scene.add_joints(da.Gear("gear", "A", "B", axis=N.z, ratio=n, housing="C"))
    start = {"a": 0, "b": 0, "c": 0, "a_dot": 0, "c_dot": 0}
    run = compiled(scene, ["gear.torque"]).simulate((0, 1), start, {**GEARED, Ic: 0.7}, rtol=1e-10)
    of_b = np.array([3.0, -2.0])
    second = np.linalg.solve(np.diag([0.3, 0.7]) + 0.2 * np.outer(of_b, of_b), [1.5, 0])
    assert [run["a_dot"][-1], run["c_dot"][-1]] == pytest.approx(second, abs=1e-9)
    assert run["gear.torque"] == pytest.approx(0.2 * of_b @ second, abs=1e-12)


def test_a_planet_inside_of_a_fixed_ring():
    """The ring is the fixed frame: b = c - n c, that is, b turns -n times as fast relative to the carrier."""
    scene, _ = shafts(Ia, Ib, Ic)
    scene.add_loads((scene.bodies[2].frame, 2 * tau * N.z))
    scene.add_joints(da.Gear("ring", None, "B", axis=N.z, ratio=n, housing="C"))
    model = compiled(scene, ["ring.torque"])
    assert "ring" in model.explain()
    start = {"a": 0, "b": 0, "c": 0, "a_dot": 0, "c_dot": 0}
    run = model.simulate((0, 1), start, {**GEARED, Ic: 0.7}, rtol=1e-10)
    rate = 3.0 / (0.7 + 4 * 0.2)
    assert [run["b"][-1], run["c"][-1]] == pytest.approx([-rate, rate / 2], abs=1e-9)
    assert run["ring.torque"] == pytest.approx(-2 * 0.2 * rate, abs=1e-12)


def test_a_rope_that_a_drum_winds():
    """The tension of a rope of length l - n a turns the drum, too, which a rope between two points does not."""
    scene, (a,) = shafts(Ia)
    with pytest.raises(SceneError, match=r"the length .* depends on a, .* write the constraint and two joints"):
        scene.add_joints(da.Rope("rope", None, "A", parent_point=O, child_point=O, length=l - n * a))


def test_faults_of_gears():
    scene, (a, b) = shafts(Ia, Ib)
    good = {"name": "gear", "parent": "A", "child": "B", "axis": N.z, "ratio": n}
    for changed, text in (
        ({"ratio": 0}, "its ratio must be a number or an expression of parameters, and not zero"),
        ({"axis": scene.bodies[0].frame.x}, "the axis A.x is not fixed in the fixed frame"),
        ({"axis": 1}, "axis must be a Vector such as N.z, not 1"),
        ({"child": None}, "which can turn; a fixed wheel is the parent, with a housing= that turns"),
        ({"parent": None}, "its parent must be a RigidBody of the scene"),
        ({"housing": "B"}, "its bodies must be three"),
        ({"angles": (b, a)}, "angles= are not those of the bodies about its axes"),
        ({"angles": a}, "angles must be those of parent and child, two expressions"),
        ({"parent": "X"}, "'X' is no body of the scene; known: A, B"),
    ):
        with pytest.raises(SceneError) as caught:
            scene.add_joints(da.Gear(**good | changed))
        assert text in str(caught.value)
    scene.add_joints(da.Gear(**good))
    with pytest.raises(OptionError, match=r"joint 'gear' has no components on axes, but gear\.torque: leave frame out"):
        scene.reaction("gear", frame=N)
    with pytest.raises(SceneError, match="two joints are called 'gear'"):
        scene.add_joints(da.Gear(**good))
