"""Potential energies of loads are derived: energy is kept where all loads have one, and what is left out is named."""

import warnings

import numpy as np
import pytest
import sympy as sp
from sympy import Max, Piecewise, Rational, cos, exp, sin
from sympy.physics.mechanics import (
    LinearPathway,
    LinearSpring,
    Particle,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da
from dalembert.errors import EnergyWarning
from dalembert.ir.graph import Graph
from dalembert.ir.random_points import match
from dalembert.mechanics import derive as deriving
from dalembert.mechanics.load_energy import LoadEnergy
from dalembert.scene.expressions.reader import ExpressionReader
from dalembert.transforms.antiderivatives import Antiderivatives

t = dynamicsymbols._t
x, y, z, w = dynamicsymbols("x y z w")
k, l, a, b = sp.symbols("k l a b", positive=True)
P_VALUES = {"k": 1.7, "l": 0.9, "a": 0.4, "b": 0.6}


def bead(loads, coordinates=(x,), gravity=False, potential=0):
    """Return a particle at (x, y, z), as far as these are coordinates."""
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("bead", frame=N, origin=O, coordinates=list(coordinates))
    axes = (N.x, N.y, N.z)
    P = O.locatenew("P", sum((q * e for q, e in zip(coordinates, axes, strict=False)), 0 * N.x))
    body = Particle("bead", P, 1.3)
    body.potential_energy = potential
    scene.add_bodies(body)
    scene.add_loads(*loads(N, O, P))
    if gravity:
        scene.apply_uniform_gravity(-9.81 * N.y)
    return scene


def pair(loads):
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("pair", frame=N, origin=O, coordinates=[x, y, z, w])
    P, Q = O.locatenew("P", x * N.x + y * N.y), O.locatenew("Q", z * N.x + w * N.z)
    scene.add_bodies(Particle("p", P, 1.3), Particle("q", Q, 2.0))
    scene.add_loads(*loads(N, P, Q))
    return scene


def pendulum(loads, relative=False):
    N, O = ReferenceFrame("N"), Point("O")
    q = dynamicsymbols("q1:4")
    scene = da.Scene("pendulum", frame=N, origin=O, coordinates=q)
    frames, points = [N], [O]
    for i, angle in enumerate(q):
        frames.append((frames[-1] if relative else N).orientnew(f"B{i}", "Axis", (angle, N.z)))
        points.append(points[-1].locatenew(f"P{i}", -l * frames[-1].y))
        scene.add_bodies(Particle(f"m{i}", points[-1], 1.3))
    scene.apply_uniform_gravity(-9.81 * N.y)
    scene.add_loads(*loads(N, frames, points, q))
    return scene


def pulled(P, Q):
    """Return the force on P of a spring of length l to Q."""
    d = P.pos_from(Q)
    return -k * (1 - l / d.magnitude()) * d


CONSERVATIVE = {
    "along a coordinate": lambda: bead(lambda N, O, P: [(P, -k * x * N.x)]),
    "with decimals": lambda: bead(lambda N, O, P: [(P, -0.7 * (x - 0.3) * N.x)]),
    "nonlinear": lambda: bead(lambda N, O, P: [(P, (-k * x - a * x**3 + b * sin(2 * x) - exp(x / 3)) * N.x)]),
    "bilinear": lambda: bead(lambda N, O, P: [(P, Piecewise((-k * x, x < a), (-2 * k * x, True)) * N.x)]),
    "steps": lambda: bead(
        lambda N, O, P: [(P, -sp.Heaviside(x + y - 2) * (N.x + N.y) - k * sp.sign(x - 1) * N.x)], (x, y)
    ),
    "stop": lambda: bead(lambda N, O, P: [(P, (-k * x - 90 * Max(0, x - l) ** sp.Rational(3, 2)) * N.x)]),
    "Lennard-Jones": lambda: bead(lambda N, O, P: [(P, (a / x**13 - b / x**7) * N.x)]),
    "isotropic": lambda: bead(lambda N, O, P: [(P, -k * P.pos_from(O))], (x, y, z), gravity=True),
    "coupled": lambda: bead(
        lambda N, O, P: [(P, (-k * x - b * (x - y) - x * y**2) * N.x + (-a * y + b * (x - y) - x**2 * y) * N.y)], (x, y)
    ),
    "to a fixed point": lambda: bead(lambda N, O, P: [(P, pulled(P, O))], (x, y), gravity=True),
    "rope": lambda: bead(
        lambda N, O, P: [(P, -k * Max(0, P.pos_from(O).magnitude() - l) / P.pos_from(O).magnitude() * P.pos_from(O))],
        (x, y),
        gravity=True,
    ),
    "gravitation": lambda: pair(
        lambda N, P, Q: [
            (P, -k / P.pos_from(Q).magnitude() ** 3 * P.pos_from(Q)),
            (Q, k / P.pos_from(Q).magnitude() ** 3 * P.pos_from(Q)),
        ]
    ),
    "between points, apart": lambda: pair(
        lambda N, P, Q: [(P, pulled(P, Q)), (P, -b * x * N.x), (Q, -pulled(P, Q)), (Q, -z * N.x)]
    ),
    "actuator": lambda: pair(lambda N, P, Q: LinearSpring(k, LinearPathway(P, Q), l).to_loads()),
    "constant": lambda: pendulum(lambda N, F, P, q: [(P[2], k * N.x), (P[1], -2 * N.y)]),
    "hinges": lambda: pendulum(
        lambda N, F, P, q: [
            (F[1], -k * q[0] * N.z),
            (F[2], -k * sin(q[1] - q[0]) * N.z),
            (F[1], k * sin(q[1] - q[0]) * N.z),
        ]
    ),
    "relative hinges": lambda: pendulum(
        lambda N, F, P, q: [(F[2], -k * q[1] ** 3 * N.z), (F[1], k * q[1] ** 3 * N.z)], relative=True
    ),
    "on a pendulum": lambda: pendulum(lambda N, F, P, q: [(P[2], -k * (P[2].pos_from(P[0]) - a * N.x))]),
}


def motion(scene, end=1.0, rtol=1e-9):
    model = da.compile_model(scene, backend="numpy")
    layout, draw = model.layout, np.random.default_rng(0)
    start = dict(zip(layout.coordinates, draw.uniform(0.6, 1.2, len(layout.coordinates)), strict=True))
    start |= dict(zip(layout.rates, draw.uniform(-0.5, 0.5, len(layout.rates)), strict=True))
    used = {name: P_VALUES[name] for name in layout.parameters}
    return model, model.simulate((0, end), start, used, rtol=rtol, atol=1e-11)


@pytest.mark.parametrize("name", CONSERVATIVE)
def test_energy_is_kept(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model, run = motion(CONSERVATIVE[name]())
        energy = run["energy"]
    assert run.success and np.ptp(run["kinetic_energy"]) > 1e-3
    assert np.ptp(energy) < 1e-7 * np.abs(run["potential_energy"]).max() + 1e-7
    assert "energy" in run.invariants
    assert "energy        with the potential energy of" in model.explain()
    assert not model.stages.equations.load_energy.unknown


def test_values_are_those_of_the_text():
    spring = motion(bead(lambda N, O, P: [(P, -k * (x - l) * N.x)]))[1]
    np.testing.assert_allclose(spring["potential_energy"], 1.7 * (spring["x"] - 0.9) ** 2 / 2, rtol=1e-12)
    run = motion(bead(lambda N, O, P: [(P, pulled(P, O))], (x, y)))[1]
    r = np.hypot(run["x"], run["y"])
    np.testing.assert_allclose(run["potential_energy"], 1.7 * (r - 0.9) ** 2 / 2, rtol=1e-9, atol=1e-12)
    run = motion(bead(lambda N, O, P: [(P, -k * (x - a * sin(t)) * N.x)]))[1]
    expected = 1.7 * (run["x"] - 0.4 * np.sin(run.t)) ** 2 / 2
    np.testing.assert_allclose(run["potential_energy"], expected, rtol=1e-12)


def test_what_the_energy_leaves_out():
    follower = pendulum(lambda N, F, P, q: [(P[2], k * F[2].x)])
    model, run = motion(follower)
    assert "force at 'P1' (no potential energy known)" in model.explain()
    for name in ("energy", "potential_energy"):
        with pytest.warns(EnergyWarning, match="\"energy\" is without the work of force at 'P1'"):
            run[name]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run["kinetic_energy"]
    with pytest.warns(EnergyWarning, match="force at 'P1'"):
        da.compile_model(follower, backend="numpy", outputs=["energy"])
    curl = bead(lambda N, O, P: [(P, -k * y * N.x + k * x * N.y)], (x, y))
    assert motion(curl)[0].stages.equations.load_energy.unknown == ("force at 'P'",)


def test_a_clipped_force_has_its_potential_on_both_sides_of_the_bound():
    _, run = motion(bead(lambda N, O, P: [(P, Max(-1, sp.Min(1, -5 * x)) * N.x)]), end=3.0)
    x_run = run["x"]
    assert x_run.min() < 0 and x_run.max() > 0.6
    expected = np.where(abs(x_run) < 0.2, 2.5 * x_run**2, abs(x_run) - 0.1)
    differences = run["potential_energy"] - expected
    assert np.ptp(differences) < 1e-12 and np.ptp(run["energy"]) < 1e-7


@pytest.mark.parametrize(
    "force",
    [
        Max(-1, sp.Min(1, -5 * x - 6 * y)),  # at its bound at most points of moderate size
        -k * x - Max(0, y - 2) * x,
        -k * x * Max(1, y / 100),
        -k * x * Piecewise((1, y < 2), (y, True)),
        -k * x * sp.Heaviside(y - Rational(1, 2)),  # its potential would jump at y = 1/2
        -sp.Heaviside(x - 2) * sp.Heaviside(y + 3),
        -k * x * da.table(y, [0, 0.5, 5], [1, 2, 2], kind="hold", extrapolate="hold"),
    ],
)
def test_a_force_that_depends_on_another_coordinate_behind_a_branch_has_no_potential(force):
    scene = bead(lambda N, O, P: [(P, force * N.x)], (x, y))
    assert motion(scene)[0].stages.equations.load_energy.unknown == ("force at 'P'",)


@pytest.mark.parametrize("start", [0, 5])
def test_a_pulse_on_a_body_that_turns_has_no_potential(start):
    """It is 0 at the random times at which potentials are compared with loads, and where time is 0 or 1."""
    N, O = ReferenceFrame("N"), Point("O")
    angle = w
    F = N.orientnew("F", "Axis", (angle, N.y))
    scene = da.Scene("follower", frame=N, origin=O, coordinates=[angle, x])
    P = O.locatenew("P", x * F.x + Rational(3, 10) * x * F.z)
    scene.add_bodies(RigidBody("body", O, F, 1, (inertia(F, 1, 1, 1), O)), Particle("bead", P, 1))
    pulse = Piecewise((0, t < start + Rational(1, 5)), (5, t < start + Rational(3, 10)), (0, True))
    scene.add_loads((P.locatenew("Q", F.x + F.z), pulse * F.x))
    model = da.compile_model(scene, backend="numpy", outputs=["energy", "kinetic_energy"])
    assert model.stages.equations.load_energy.time == ("force at 'Q'",)
    times = [0, start + 0.25, start + 1.0]
    run = model.simulate((0, times[-1]), {"w": 0.1, "x": 0.2, "w_dot": 0.3, "x_dot": 0.1}, {}, t_eval=times)
    np.testing.assert_array_equal(run["energy"], run["kinetic_energy"])


def test_dampers_and_drives_are_named_and_not_warned_of():
    scene = bead(lambda N, O, P: [(P, (-k * x - a * x.diff()) * N.x), (P, b * cos(t) * N.x)])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model, run = motion(scene)
        potential = run["potential_energy"]
    np.testing.assert_allclose(potential, 1.7 * run["x"] ** 2 / 2, rtol=1e-12)
    text = model.explain()
    assert "force at 'P' (as far as it depends on rates)" in text and "force at 'P' (depends on time)" in text
    with pytest.raises(da.errors.OptionError, match="do work: force at 'P'"):
        model.simulate((0, 1), {"x": 1, "x_dot": 0}, {"k": 1, "a": 1, "b": 0}, project_invariants="energy")


def test_a_declared_potential_replaces_a_derived_one():
    for gravity in (False, True):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            scene = bead(lambda N, O, P: [(P, -k * x * N.x)], (x, y), gravity, potential=k * x**2 / 2 + 5)
            run = motion(scene)[1]
            weight = 1.3 * 9.81 * run["y"] if gravity else 0
            np.testing.assert_allclose(run["potential_energy"] - weight, 1.7 * run["x"] ** 2 / 2 + 5, rtol=1e-12)
    with pytest.warns(EnergyWarning, match="along x, minus its derivative is not the force of force at 'P'"):
        run = motion(bead(lambda N, O, P: [(P, -k * x * N.x)], potential=3 * k * x**2))[1]
    np.testing.assert_allclose(run["potential_energy"], 3 * 1.7 * run["x"] ** 2, rtol=1e-12)


def test_a_declared_potential_stands_for_one_of_two_springs():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = bead(lambda N, O, P: [(P, -k * x * N.x), (P, -a * x**3 * N.x)], potential=k * x**2 / 2)
        run = motion(scene)[1]
    assert np.ptp(run["energy"]) < 1e-7


def test_a_weight_that_is_declared_in_decimals_counts_once():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = motion(bead(lambda N, O, P: [], (x, y), True, potential=12.753 * y))[1]
    np.testing.assert_allclose(run["potential_energy"], 12.753 * run["y"], rtol=1e-12)


def test_a_potential_that_is_known_to_nobody_but_the_user():
    """exp(-x^2) has no elementary antiderivative."""
    force = lambda N, O, P: [(P, -k * exp(-(x**2)) * N.x)]  # noqa: E731
    with pytest.warns(EnergyWarning, match="declare it"):
        motion(bead(force))[1]["energy"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(da.errors.SceneError, match="erf"):
            da.compile_model(bead(force, potential=k * sp.sqrt(sp.pi) / 2 * sp.erf(x)), backend="numpy")


def test_sweeps_reductions_and_constraints():
    scene = bead(lambda N, O, P: [(P, -k * (P.pos_from(O) - a * N.x))], (x, y), gravity=True)
    scene.add_holonomic_constraints(x**2 + y**2 - l**2)
    start = {"x": 0.0, "y": -0.9, "x_dot": 0.8}
    model = da.compile_model(scene, backend="numpy")
    sweep = model.sweep((0, 1), start, {"k": [0.5, 1.7], "a": 0.4, "l": 0.9}, t_eval=[0.0, 0.5, 1.0], rtol=1e-10)
    assert np.ptp(sweep["energy"], axis=1).max() < 1e-7 and np.abs(sweep["potential_energy"]).max() > 1
    kept = model.simulate((0, 1), start, {"k": 1.7, "a": 0.4, "l": 0.9}, rtol=1e-6, project_invariants=True)
    assert np.ptp(kept["energy"]) < 1e-12


def test_the_motion_does_not_depend_on_the_derivation(monkeypatch):
    """Potentials are derived on a graph of their own: all kernels but those of the energies stay as they are."""
    scene = CONSERVATIVE["between points, apart"]
    new = da.compile_model(scene(), backend="numpy").stages.program
    monkeypatch.setattr(deriving, "load_energy", lambda *arguments: LoadEnergy())
    old = da.compile_model(scene(), backend="numpy").stages.program
    assert new.kernel("rhs") == old.kernel("rhs") and new.kernel("energy") != old.kernel("energy")


@pytest.mark.parametrize("name", ["along a coordinate", "isotropic", "coupled", "on a pendulum"])
def test_the_textbook_view_has_the_same_energy(name):
    scene = CONSERVATIVE[name]()
    energy = next(i for i in da.lagrange(scene).first_integrals if i.name == "energy").expression
    model = da.compile_model(scene, backend="numpy", outputs=[energy])
    layout = model.layout
    start = dict.fromkeys((*layout.coordinates, *layout.rates), 0.3) | {layout.rates[0]: 0.9}
    run = model.simulate((0, 0.5), start, {name: P_VALUES[name] for name in layout.parameters})
    difference = run["energy"] - run[energy]
    np.testing.assert_allclose(difference, difference[0], atol=1e-10)


@pytest.mark.parametrize(
    "e",
    [
        k * x**3 - a * x + b,
        k * (x - l) ** 3,
        k / (x - l) ** 2,
        k / x,
        k * x * (sp.sqrt(x**2 + l**2) - a) / sp.sqrt(x**2 + l**2),
        sin(2 * x + a) * cos(2 * x + a),
        k * x * exp(-(x**2)),
        a * sp.cosh(x) * sp.sinh(x) ** 3,
        k * (Max(0, x - l) - Max(0, -l - x)),
        k * (x - l) * sp.Heaviside(x - l),
        k * sp.sqrt(sp.Abs(x)) * sp.sign(x),
        sp.tanh(x / a) + sp.atan(x) + sp.log(x + 3),
    ],
)
def test_antiderivatives(e):
    graph = Graph()
    node = graph.input("x")
    f = ExpressionReader(graph, {x: node}).read(e, "")
    tool = Antiderivatives(graph, [node])
    assert match([tool.slope(tool.by_input(f, node), node)], [f])


@pytest.mark.parametrize("e", [exp(-(x**2)), sin(x**2), sp.Abs(sin(x**2))])
def test_no_antiderivative(e):
    graph = Graph()
    node = graph.input("x")
    assert Antiderivatives(graph, [node]).by_input(ExpressionReader(graph, {x: node}).read(e, ""), node) is None


def test_springs_between_points_that_resist_in_all_directions_have_a_potential():
    """A leg with its rest length along the vertical, between a body that turns in space and a foot."""
    N, O = ReferenceFrame("N"), Point("O")
    c = sp.Symbol("c", positive=True)
    turns, foot = dynamicsymbols("r p q"), dynamicsymbols("u v s")
    scene = da.Scene("leg", frame=N, origin=O, coordinates=[x, y, z, *turns, *foot])
    B = N.orientnew("B", "Body", turns, "XYZ")
    C = O.locatenew("C", x * N.x + y * N.y + z * N.z)
    hip, P = C.locatenew("H", a * B.x - b * B.z), O.locatenew("P", foot[0] * N.x + foot[1] * N.y + foot[2] * N.z)
    scene.add_bodies(RigidBody("trunk", C, B, 2.0, (inertia(B, 0.3, 0.4, 0.5), C)), Particle("foot", P, 0.7))
    leg = hip.pos_from(P)
    force = -k * (leg - l * N.z) - c * leg.dt(N)
    scene.add_loads((hip, force), (P, -force))
    with warnings.catch_warnings():
        warnings.simplefilter("error", EnergyWarning)
        model = da.compile_model(scene, outputs=["energy"])
    start = dict.fromkeys(model.layout.variables, 0.1) | {"p": 0.4, "z": 1.2, "r_dot": 0.6}
    run = model.simulate((0.0, 3.0), start, {**P_VALUES, "c": 0.0}, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(run["energy"], run["energy"][0], rtol=1e-11)
    assert np.ptp(run["kinetic_energy"]) > 0.1
