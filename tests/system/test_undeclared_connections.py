"""Hidden reactions where a point belongs to several bodies, against Newton and Euler by hand."""

import numpy as np
import pytest
from sympy import cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import ConstraintError

m, M, J, r, g, l, L = symbols("m M J r g l L", positive=True)
phi, psi, x = dynamicsymbols("phi psi x")
N, O = ReferenceFrame("N"), Point("O")
X, Y, X_2, Y_2, F, T, T_2, V, K = da.unknowns("X Y X_2 Y_2 F T T_2 V K")
A, B = N.orientnew("A", "Axis", (phi, N.z)), N.orientnew("B", "Axis", (psi, N.z))
FIXED = N.orientnew("FIXED", "Axis", (0, N.z))
VALUES = {m: 0.6, M: 2.0, J: 0.3, r: 0.25, g: 9.81, l: 0.7, L: 0.4}


def body(name, centre, frame, mass=m):
    return RigidBody(name, centre, frame, mass, (inertia(frame, 0, 0, J), centre))


def scene_of(coordinates, bodies, joints):
    scene = da.Scene("scene", frame=N, origin=O, coordinates=coordinates)
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_bodies(*bodies)
    scene.add_joints(*joints)
    return scene


def values_of(scene, outputs, **compiled):
    model = da.compile_model(scene, backend="numpy", outputs=outputs, **compiled)
    known = {p: value for p, value in VALUES.items() if p.name in model.stages.model.symbols.parameters}
    start = {q: 0.3 for q in scene.coordinates} | {q.diff(): 0.5 for q in scene.coordinates}
    if scene.holonomic_constraints:
        start = {phi: 0.3, phi.diff(): 0.5, x: 0.075, x.diff(): 0.125}
    run = model.simulate((0, 0.1), start, known, t_eval=[0, 0.1])
    return [run[name][0] for name in outputs]


def undetermined(scene, outputs, text):
    with pytest.raises(ConstraintError, match=text):
        da.compile_model(scene, backend="numpy", outputs=outputs)


# -- rack and pinion -----------------------------------------------------------------------------------


def rack(joints, *, rigid, constrained, first="wheel"):
    """A rack located from the origin, which is a point of the fixed frame and the mass centre of the wheel."""
    Q = O.locatenew("Q", (x if constrained else r * phi) * N.x - r * N.y)
    C = O.locatenew("C", -r * N.y)
    bodies = [body("wheel", O, A, M), body("rack", Q, FIXED) if rigid else Particle("rack", Q, m)]
    listed = {
        "axle": da.Joint("axle", body="wheel", at=O, force=X * N.x + Y * N.y),
        "mesh": da.Joint("mesh", body="rack", other="wheel", at=C, force=F * N.x + T * N.y),
        "tooth": da.Joint("tooth", body="rack", other="wheel", at=C, force=F * N.x),
        "guide": da.Joint("guide", body="rack", at=Q, force=V * N.y),
    }
    bodies = bodies if first == "wheel" else bodies[::-1]
    scene = scene_of([phi, x] if constrained else [phi], bodies, [listed[name] for name in joints])
    scene.add_loads((A, -0.7 * N.z))
    if constrained:
        scene.add_holonomic_constraints(x - r * phi)
    return scene


@pytest.mark.parametrize("first", ["wheel", "rack"])
@pytest.mark.parametrize(("rigid", "constrained"), [(False, True), (True, False), (True, True)])
def test_mesh_of_a_rack_that_the_ground_may_carry_too(rigid, constrained, first):
    for joints in (["axle", "mesh"], ["mesh"]):
        scene = rack(joints, rigid=rigid, constrained=constrained, first=first)
        undetermined(scene, ["T"], r"T would be another .*'rack' and the fixed frame.*, which no joint declares")
        undetermined(scene, ["F", "T"], "'rack' and the fixed frame")
    (found,) = values_of(rack(["axle", "mesh"], rigid=rigid, constrained=constrained, first=first), ["F"])
    push = -0.7 * 0.25 / (0.3 + 0.6 * 0.25**2)  # acceleration of the rack
    assert found == pytest.approx(0.6 * push, rel=1e-12)


@pytest.mark.parametrize("rigid", [False, True])
def test_guide_of_a_rack_that_teeth_may_press(rigid):
    """The force of inclined teeth has a component along the guide's."""
    scene = rack(["axle", "guide"], rigid=rigid, constrained=False)
    undetermined(scene, ["V"], "V would be another .* between 'rack' and 'wheel'")
    undetermined(scene, ["Y"], "Y would be another .* between 'rack' and 'wheel'")
    undetermined(
        rack(["axle", "tooth", "guide"], rigid=rigid, constrained=True), ["V"], "only a combination of V with Y"
    )


# -- bodies that share a mass centre -----------------------------------------------------------------------


def shafts(joints, first):
    bodies = {"inner": body("inner", O, A), "outer": body("outer", O, B, M)}
    listed = {
        "inner": da.Joint("inner", body="inner", at=O, force=X * N.x + Y * N.y),
        "outer": da.Joint("outer", body="outer", at=O, force=X_2 * N.x + Y_2 * N.y),
        "between": da.Joint("between", body="outer", other="inner", at=O, force=X_2 * N.x + Y_2 * N.y),
    }
    order = [first, *(name for name in bodies if name != first)]
    return scene_of([phi, psi], [bodies[name] for name in order], [listed[name] for name in joints])


@pytest.mark.parametrize("first", ["inner", "outer"])
def test_concentric_shafts(first):
    undetermined(shafts(["inner"], first), ["Y"], "'outer' and the fixed frame")
    undetermined(shafts(["outer"], first), ["Y_2"], "'inner' and the fixed frame")
    weights = 0.6 * 9.81, 2.0 * 9.81
    assert values_of(shafts(["inner", "outer"], first), ["Y", "Y_2"]) == pytest.approx(weights, rel=1e-12)
    both = sum(weights), weights[1]
    assert values_of(shafts(["inner", "between"], first), ["Y", "Y_2"]) == pytest.approx(both, rel=1e-12)


@pytest.mark.parametrize("reverse", [False, True])
def test_wheel_on_a_carriage_about_its_mass_centre(reverse):
    C = O.locatenew("C", x * N.x)
    W = N.orientnew("W", "Axis", (-x / r, N.z))
    bodies = [body("carriage", C, FIXED, M), body("wheel", C, W)][:: -1 if reverse else 1]
    axle = da.Joint("axle", body="wheel", other="carriage", at=C, force=X * N.x + Y * N.y)
    contact = da.Joint("contact", body="wheel", at=C.locatenew("E", -r * N.y), force=F * N.x + V * N.y)
    guide = da.Joint("guide", body="carriage", at=C, force=Y_2 * N.y, torque=K * N.z)
    undetermined(scene_of([x], bodies, [axle]), ["Y"], "'carriage' and the fixed frame")
    undetermined(scene_of([x], bodies, [contact]), ["V"], "'carriage' and the fixed frame")
    undetermined(scene_of([x], bodies, [axle, contact]), ["Y", "V"], "'carriage' and the fixed frame")
    undetermined(scene_of([x], bodies, [axle, guide]), ["Y"], "'wheel' and the fixed frame")
    pushed = scene_of([x], bodies, [axle, contact, guide])
    pushed.add_loads(("carriage", C, 3 * N.x))
    a = 3 / (2.6 + 0.3 / 0.25**2)
    found = values_of(pushed, ["X", "F"])
    assert found == pytest.approx([0.6 * a + 0.3 * a / 0.25**2, -0.3 * a / 0.25**2], rel=1e-12)


# -- what is the same whatever else is carried --------------------------------------------------------------


def test_pulley_with_a_rope_and_a_pendulum_beside_a_wheel():
    left = O.locatenew("left", -r * N.x - (r * phi + l) * N.y)
    right = O.locatenew("right", r * N.x + (r * phi - l) * N.y)
    bodies = body("pulley", O, A, M), Particle("one", left, m), Particle("two", right, M)
    joints = [
        da.Joint("first", body="one", other="pulley", at=left, force=T * N.y),
        da.Joint("second", body="two", other="pulley", at=right, force=T_2 * N.y),
        da.Joint("axle", body="pulley", at=O, force=X * N.x + Y * N.y),
    ]
    a = (0.6 - 2) * 9.81 / (2.6 + 0.3 / 0.25**2)
    ropes = [0.6 * (9.81 - a), 2 * (9.81 + a)]
    wanted = [*ropes, 2 * 9.81 + sum(ropes)]
    assert values_of(scene_of([phi], bodies, joints), ["T", "T_2", "Y"]) == pytest.approx(wanted, rel=1e-12)
    for i, name in enumerate(["T", "T_2", "Y"]):
        assert values_of(scene_of([phi], bodies, [joints[i]]), [name]) == pytest.approx([wanted[i]], rel=1e-12)
    S = N.orientnew("S", "Axis", (psi, N.z))
    P = O.locatenew("P", -l * S.y)
    rod = da.Joint("rod", body="bob", at=P, force=T * S.y)
    axle = da.Joint("axle", body="wheel", at=O, force=X * N.x + Y * N.y)
    scene = scene_of([phi, psi], [body("wheel", O, A, M), Particle("bob", P, m)], [rod, axle])
    found = values_of(scene, ["T", "Y"])
    assert found == pytest.approx([0.6 * (0.7 * 0.25 + 9.81 * np.cos(0.3)), 2 * 9.81], rel=1e-12)


def test_pins_of_links_that_are_all_located_from_the_origin():
    """The pins explain where the links are: nothing else need carry them."""
    ends = [l * (cos(phi) * N.x + sin(phi) * N.y), L * (cos(psi) * N.x + sin(psi) * N.y)]
    P, G = O.locatenew("P", ends[0]), O.locatenew("G", ends[0] / 2)
    Q, H = O.locatenew("P_2", l * A.x), O.locatenew("G_2", l / 2 * A.x)
    found = []
    for pin, one, other in ((P, G, O.locatenew("H", ends[0] + ends[1])), (Q, H, Q.locatenew("H_2", L * B.x))):
        joints = [
            da.Joint("first", body="upper", at=O, force=X * N.x + Y * N.y),
            da.Joint("second", body="lower", other="upper", at=pin, force=X_2 * N.x + Y_2 * N.y),
        ]
        scene = scene_of([phi, psi], [body("upper", one, A), body("lower", other, B)], joints)
        found.append(values_of(scene, ["X", "Y", "X_2", "Y_2"]))
    assert found[0] == pytest.approx(found[1], rel=1e-11)


def test_axles_of_gears_without_their_mesh():
    """The force of the teeth along the line of centres is unknown, that across follows from the torque."""
    D = O.locatenew("D", 2 * r * N.x)
    W = N.orientnew("W", "Axis", (-phi, N.z))
    joints = [
        da.Joint("first", body="one", at=O, force=X * N.x + Y * N.y),
        da.Joint("second", body="two", at=D, force=X_2 * N.x + Y_2 * N.y),
    ]
    scene = scene_of([phi], [body("one", O, A), body("two", D, W, M)], joints)
    undetermined(scene, ["X"], "X would be another .* between 'two' and 'one'")
    scene.add_loads((A, 0.7 * N.z))
    push = 0.35 / 0.25  # half of the torque accelerates the second
    assert values_of(scene, ["Y", "Y_2"]) == pytest.approx([0.6 * 9.81 + push, 2 * 9.81 - push], rel=1e-12)


def test_a_wheel_that_rolls_beside_a_cart_has_a_contact():
    """Free rolling needs no force of the ground, which may carry the wheel all the same."""
    C = O.locatenew("C", x * N.x + 2 * r * N.y)
    E = C.locatenew("E", l * N.x - r * N.y)
    bodies = body("cart", C, FIXED, M), body("wheel", E, N.orientnew("W", "Axis", (-x / r, N.z)))
    axle = da.Joint("axle", body="wheel", other="cart", at=E, force=X * N.x + Y * N.y)
    guide = da.Joint("guide", body="cart", at=C, force=V * N.y, torque=K * N.z)
    rolls = scene_of([x], bodies, [axle, guide])
    for output in ("X", "Y"):
        with pytest.raises(ConstraintError, match=r"'wheel'.* is missing, which no joint declares"):
            da.compile_model(rolls, outputs=[output])
    road = da.Joint("road", body="wheel", at=E.locatenew("D", -r * N.y), force=F * N.x + T * N.y)
    pulled = scene_of([x], bodies, [axle, guide, road])
    pulled.add_loads((C, 5 * N.x))
    with pytest.raises(ConstraintError, match="Y"):
        da.compile_model(pulled, outputs=["Y"])
    mass = VALUES[m] + VALUES[J] / VALUES[r] ** 2
    assert values_of(pulled, ["X"]) == pytest.approx([5 * mass / (VALUES[M] + mass)], rel=1e-12)
