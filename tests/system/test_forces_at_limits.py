"""Forces that rise to the limit of friction and stay there, or return: the contact sticks, whatever rounding does."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da

t, u = dynamicsymbols._t, dynamicsymbols("u")
r, F0 = sp.symbols("r F_0", positive=True)
FORCES = {
    "minimum": sp.Min(r * t, F0),
    "piecewise": sp.Piecewise((r * t, t < F0 / r), (F0, True)),
    "from a preload": sp.Min(F0 * sp.Rational(9, 10) + r * t / 10, F0),
    "jump": sp.Piecewise((r * t / 2, t < F0 / r), (F0, True)),
    "there and back": F0 * sp.sin(r * t / F0),
    "rational": 4 * F0 * (r * t / F0) / (1 + r * t / F0) ** 2,
}
METHODS = ("taylor", "dop853", "tsit5", "radau")


def block(force, kind="line"):
    """Return the scene of a block on a rough floor, with friction along a line or in the plane."""
    m, g, mu, mu_s = sp.symbols("m g mu mu_s", positive=True)
    x, y, z = dynamicsymbols("x y z")
    N, O = ReferenceFrame("N"), Point("O")
    plane = kind == "plane"
    scene = da.Scene("block", frame=N, origin=O, coordinates=[x, *[y] * plane, z])
    P = O.locatenew("P", x * N.x + (y * N.y if plane else 0) + z * N.z)
    scene.add_bodies(Particle("block", P, m))
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_loads((P, force * (N.x * sp.Rational(3, 5) + N.y * sp.Rational(4, 5) if plane else N.x)))
    if u in force.atoms(sp.Function):
        scene.add_inputs(u)
    R, T, U = da.unknowns("R T U")
    scene.add_joints(da.Joint("floor", body="block", at=P, force=R * N.z + T * N.x + (U * N.y if plane else 0)))
    scene.add_contacts(da.UnilateralContact(R, gap=z, name="floor"))
    scene.add_friction(da.CoulombFriction(R, (T, U) if plane else T, mu=mu, mu_static=mu_s, name="floor"))
    return scene


def block_on_feet(force, reach):
    """Return the scene of a block that can turn on two rough feet, one of them so many times as far away."""
    m, g, mu, mu_s = sp.symbols("m g mu mu_s", positive=True)
    x, z, theta = dynamicsymbols("x z theta")
    N, O = ReferenceFrame("N"), Point("O")
    B = N.orientnew("B", "Axis", [theta, -N.y])
    scene = da.Scene("block", frame=N, origin=O, coordinates=[x, z, theta])
    C = O.locatenew("C", x * N.x + z * N.z)
    C.set_vel(N, C.pos_from(O).dt(N))
    scene.add_bodies(RigidBody("block", C, B, m, (inertia(B, 0, m, 0), C)))
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_loads((C, force * N.x))
    for name, place in (("A", -1), ("B", reach)):
        foot, (R, T) = C.locatenew(name, place * B.x), da.unknowns(f"R_{name} T_{name}")
        scene.add_joints(da.Joint(name, body="block", at=foot, force=R * N.z + T * N.x))
        scene.add_contacts(da.UnilateralContact(R, gap=foot.pos_from(O).dot(N.z), name=name))
        scene.add_friction(da.CoulombFriction(R, T, mu=mu, mu_static=mu_s, name=name))
    return scene


def cases(share=1.0, count=30):
    """Return parameters, decimal numbers and products rounded in several ways, with F_0 a share of the limit."""
    rng, found = np.random.default_rng(0), []
    for i in range(count):
        m, g = np.round(rng.uniform(0.5, 20), i % 4), (9.81, 10.0, 9.80665, 1.62)[i % 3]
        mu_s = np.round(rng.uniform(0.2, 1.2), 1 + i % 3)
        limit = (mu_s * m * g, m * g * mu_s, mu_s * (m * g), float(f"{mu_s * m * g:.15g}"))[i % 4]
        rate = limit / np.round(rng.uniform(0.3, 1.5), 2) if i % 2 else np.round(limit / rng.uniform(0.3, 1.5), 2)
        found.append({"m": m, "g": g, "mu": 0.7 * mu_s, "mu_s": mu_s, "F_0": share * limit, "r": rate})
    return {name: np.array([case[name] for case in found]) for name in found[0]}


def slips(model, p, method, **options):
    """Return how many cases of a sweep slip, which single runs of some of them confirm."""
    start = dict.fromkeys(model.layout.variables, 0.0)
    p = {name: value for name, value in p.items() if name in model.layout.parameters}
    sweep = model.sweep((0, 4), start, p, method=method, **options)
    assert sweep.success.all()
    for i in range(0, len(p["m"]), 7):
        run = model.simulate((0, 4), start, {name: values[i] for name, values in p.items()}, method=method, **options)
        assert (abs(run["x"][-1]) > 1e-14) == (abs(sweep["x"][i]) > 1e-14)
    return np.count_nonzero(np.abs(sweep["x"]) > 1e-14)


@pytest.mark.parametrize("kind", ["line", "plane"])
@pytest.mark.parametrize("force", FORCES)
def test_a_contact_sticks_at_its_limit(force, kind):
    """The law is |F| <= mu_static N: what goes beyond slips, however little, and what stays below does not."""
    model = da.compile_model(block(FORCES[force], kind))
    for method in METHODS if kind == "line" else ["taylor", "dop853"]:
        assert slips(model, cases(), method) == 0, method
        assert slips(model, cases(1 + 1e-9), method) == 30, method
        assert slips(model, cases(1 - 1e-9), method) == 0, method


@pytest.mark.parametrize("kind", ["line", "plane"])
@pytest.mark.parametrize("ratio", [0.7, 1.0])
def test_polynomials_that_overshoot_the_limit_move_nothing(ratio, kind):
    """A force that just reaches its limit lies within the errors of loose steps of it, and never beyond it.

    With a coefficient of slip below that of stick the block would slip on, else phases followed each other without end.
    """
    model = da.compile_model(block(FORCES["there and back"], kind))
    p = cases() | {"mu": ratio * cases()["mu_s"]}
    for rtol in (1e-3, 1e-4, 1e-6):
        assert slips(model, p, "taylor", rtol=rtol, atol=rtol) == 0, rtol


@pytest.mark.parametrize("reach", [1, 2])
@pytest.mark.parametrize("force", ["minimum", "piecewise", "from a preload", "jump"])
def test_two_feet_stick_where_one_does(force, reach):
    """They share the load indeterminately; together they hold as much as one."""
    model = da.compile_model(block_on_feet(FORCES[force], reach))
    for method in ("taylor", "dop853"):
        assert slips(model, cases(count=8), method) == 0, method
        assert slips(model, cases(1 + 1e-9, 8), method) == 8, method
        assert slips(model, cases(1 - 1e-9, 8), method) == 0, method


@pytest.mark.parametrize("backend", ["llvm", pytest.param("numba", marks=pytest.mark.matrix), "numpy"])
def test_records_that_rise_to_the_limit(backend):
    if backend == "numba":
        pytest.importorskip("numba")
    model, p = da.compile_model(block(F0 * u), backend=backend), cases(count=8)
    ramp = {"inputs": {u: da.samples([0, 0.5, 1.3, 5], [0, 0.5, 1, 1])}}
    for method in {"taylor", "dop853"} & {*model.methods}:
        assert slips(model, p, method, **ramp) == 0
        assert slips(model, p | {"F_0": p["F_0"] * (1 + 1e-9)}, method, **ramp) == 8


def test_slip_begins_when_the_force_passes_the_limit():
    """At a kink where the force goes on to rise, and 1e-9 of it later."""
    model, p = da.compile_model(block(sp.Min(r * t, F0) + sp.Max(r * t - F0, 0) / 2)), cases()
    for i in range(30):
        one = {name: values[i] for name, values in p.items() if name in model.layout.parameters}
        at = one["F_0"] / one["r"]
        for share, begins in ((1.0, at), (1 - 1e-9, at * (1 + 1e-9)), (1 - 1e-12, at * (1 + 1e-12))):
            one["F_0"] = share * p["F_0"][i]
            run = model.simulate((0, 4), dict.fromkeys(model.layout.variables, 0.0), one)
            assert run.phases[-1].modes == {"floor": "slip"}
            assert run.phases[-1].t0 == pytest.approx(begins, rel=1e-13)


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_tables_that_rise_to_the_limit(backend):
    model = da.compile_model(block(F0 * da.table(t, [0, 1, 5], [0, 1, 1], name="ramp")), backend=backend)
    for method in {*METHODS} & {*model.methods}:
        assert slips(model, cases(), method) == 0, method
        assert slips(model, cases(1 + 1e-9), method) == 30, method
