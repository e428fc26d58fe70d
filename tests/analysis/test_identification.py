"""Regressors against inverse dynamics, base parameters against published ones, identification against its errors."""

import numpy as np
import pytest
from scipy.linalg import null_space
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from analysis.test_inverse_dynamics import P, arm, on_loop, slider
from dalembert.analysis.body_inertias import BodyInertia
from dalembert.errors import CapabilityError, OptionError, UnknownNameError, ValueInputError
from interop.robot_texts import ARM, WALKER


def scene_of(tmp_path, text, **options):
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    return da.Scene.from_urdf(path, **options)


def compiled(scene):
    return da.compile_model(scene, backend="numpy", cache=False)


def agree(model, states, p, **options):
    """Assert that W @ pi are the values of inverse dynamics to 1e-12 of the terms, and return W and pi."""
    tau = model.inverse_dynamics(0.0, *states, p, inputs=options.get("inputs"))
    W, names = model.regressor(0.0, *states, p, **options)
    pi = model.inertial_parameters(p, **{key: list(value) for key, value in options.items()})
    values = np.array(list(pi.values()))
    assert tuple(pi) == names and W.shape == (*tau.shape, len(names))
    assert np.max(np.abs(W @ values - tau)) < 1e-12 * np.max(np.abs(W) @ np.abs(values))
    return W, pi


def rolling(torques=True):
    """A ball that rolls without slip, with torques about the axes of the plane or about all."""
    scene, inputs = da.scenes.rolling_sphere(), dynamicsymbols("u v w")
    (ball,), plane = scene.bodies, scene.frame
    if torques:
        scene.add_inputs(*inputs)
        scene.add_loads(*((ball.frame, u * axis) for u, axis in zip(inputs, plane, strict=True)))
    return compiled(scene), {"m": 3.0, "r": 0.5, "g": 9.81}


def driven_states(model, p, rng, count):
    """Return states on velocity constraints with the accelerations of random inputs, and these."""
    q = rng.uniform(-1, 1, (count, len(model.layout.coordinates)))
    if any(name.endswith("_e0") for name in model.layout.coordinates):
        q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
    u = rng.normal(size=(count, len(model.layout.inputs)))
    inputs = [dict(zip(model.layout.inputs, row, strict=True)) for row in u]
    free = [null_space(model.constraint_jacobian(0, each, p, inputs=inputs[0])) for each in q]
    qdot = np.array([basis @ rng.normal(size=basis.shape[1]) for basis in free])
    second = [model.accelerations(0, *s, p, inputs=given) for *s, given in zip(q, qdot, inputs, strict=True)]
    return (q, qdot, np.array(second)), u


# -- regressors ------------------------------------------------------------------------------------


def test_regressor_of_a_robot_from_a_file(tmp_path):
    """Slanted axes, mimics, a slide, damping and dry friction: their coefficients are columns, too."""
    scene = scene_of(tmp_path, ARM, parameters="symbols")
    model, p = compiled(scene), scene.robot.parameters
    states = np.random.default_rng(1).normal(size=(3, 4, 3))
    W, pi = agree(model, states, p)
    assert list(pi)[:4] == ["upper.m", "upper.mc_x", "upper.mc_y", "upper.mc_z"] and list(pi)[-1] == "loads"
    loads = [symbol for symbol in p if str(symbol)[:2] in ("d_", "f_")]
    W, pi = agree(model, states, p, loads=loads)
    assert "loads" not in pi and list(pi)[-3:] == list(map(str, loads)) and pi["d_lift"] == 12
    other = {symbol: value * (1.5 if str(symbol)[:2] in ("m_", "I_", "d_", "f_") else 1) for symbol, value in p.items()}
    other |= {symbol: value + 0.1 for symbol, value in p.items() if str(symbol)[:2] == "c_"}
    heavier = np.array(list(model.inertial_parameters(other, loads=loads).values()))
    tau = model.inverse_dynamics(0, *states, other)
    assert np.max(np.abs(W @ heavier - tau)) < 1e-12 * np.max(np.abs(W) @ np.abs(heavier))
    one, _ = model.regressor(0, *states[:, 0], p, loads=loads)
    assert one.shape == W.shape[1:] and np.array_equal(one, W[0])


def test_regressor_of_a_floating_robot(tmp_path):
    """Base and quaternion: rows are generalised forces with no part that its norm would take; motors as inputs."""
    scene = scene_of(tmp_path, WALKER, floating_base=True, actuated=True, joint_loads=False)
    model = compiled(scene)
    states, u = driven_states(model, {}, np.random.default_rng(2), 1)
    W, _ = agree(model, states, {}, inputs=dict(zip(model.layout.inputs, u[0], strict=True)))
    e = states[0][0, 3:7]
    assert W.shape == (1, 9, 31) and np.abs(e @ W[0, 3:7]).max() < 1e-13
    W, _ = agree(model, states, {})
    assert W.shape == (1, 2, 30)


@pytest.mark.parametrize("given", [{}, {"u": 11.0}])
def test_regressor_of_a_closed_loop(given):
    """The torque of the crank; and generalised forces on the loop where it is given, which vanish."""
    model = compiled(slider())
    q, qd = on_loop(0.8, 3.0)
    W, pi = agree(model, (q, qd, model.accelerations(0, q, qd, P, inputs={"u": 11.0})), P, inputs=given)
    assert W.shape == ((3, 22) if given else (1, 21)) and "slider.m" in pi and "slider.mc_x" not in pi


def test_regressors_of_rolling():
    for torques in (True, False):
        model, p = rolling(torques)
        states, _ = driven_states(model, p, np.random.default_rng(3), 3)
        W, pi = agree(model, states, p)
        assert W.shape == (3, 3 if torques else 5, 10) and pi[next(iter(pi))] == 3.0
    sleigh, p = compiled(da.scenes.chaplygin_sleigh()), {"m": 1.3, "b": 0.3, "I_C": 0.5}
    states, _ = driven_states(sleigh, p, np.random.default_rng(3), 4)
    _, pi = agree(sleigh, states, p)
    assert [pi[f"sleigh.{name}"] for name in ("m", "mc_x", "I_zz")] == pytest.approx([1.3, 0.39, 0.5])


# -- base parameters -------------------------------------------------------------------------------


def test_base_parameters_of_two_rods():
    """The regrouped parameters of textbooks: ZZ_1 + m_2 l^2, MX_1 + m_2 l, and MX, MY, ZZ as they are."""
    model = compiled(arm(damping=False))
    W, names = model.regressor(0, *np.random.default_rng(4).normal(size=(3, 20, 2)), P)
    base = da.base_parameters(W, names)
    head = [name.split(" ")[0] for name in base.names]
    assert head == [f"{body}.{what}" for body in ("upper", "lower") for what in ("mc_x", "mc_y", "I_zz")]
    assert base.names[0] == "upper.mc_x + 0.7 lower.m" and base.names[2] == "upper.I_zz + 0.49 lower.m"
    assert "upper.m" in base.undetermined and "lower.I_xy" in base.undetermined
    pi = model.inertial_parameters(P)
    assert base.reduce(W) @ base.values(pi) == pytest.approx(W @ np.array(list(pi.values())), rel=1e-12)


PUMA = [("0 0 1", "0 0 0"), ("0 1 0", "0 0.15 0"), ("0 1 0", "0.43 -0.1 0"), ("1 0 0", "0.43 0 0.02")]
PUMA += [("0 1 0", "0 0 0"), ("1 0 0", "0 0 0")]


def test_puma_has_36_base_parameters(tmp_path):
    """The published number (Gautier and Khalil 1990; Mayeda, Yoshida, Osuka 1990)."""
    body = '<link name="l{0}"><inertial><origin xyz=".1 .2 .3"/><mass value="1"/>'
    body += '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    joint = '<joint name="j{0}" type="continuous"><parent link="l{1}"/><child link="l{0}"/>'
    joint += '<axis xyz="{2}"/><origin xyz="{3}"/></joint>'
    parts = [body.format(i) + joint.format(i, i - 1, *each) for i, each in enumerate(PUMA, 1)]
    model = compiled(scene_of(tmp_path, f'<robot name="puma"><link name="l0"/>{"".join(parts)}</robot>'))
    W, names = model.regressor(0, *np.random.default_rng(5).normal(size=(3, 40, 6)), {})
    assert len(names) == 60 and len(da.base_parameters(W, names).names) == 36


# -- identification --------------------------------------------------------------------------------


def deviations(W, names, tau, pi, sigma, draws=200):
    """Return differences of estimates from the truth in standard errors (draws, n_b)."""
    base, rng = da.base_parameters(W, names), np.random.default_rng(6)
    found = [da.identify(W, names, tau + rng.normal(size=tau.shape) * sigma, base=base) for _ in range(draws)]
    true = base.values(pi)
    return np.array([(each.values - true) / each.errors for each in found]), found[0]


def assert_standard(z):
    """Assert that deviations (draws, n) have mean 0 and spread 1, within five of their own standard errors."""
    draws = len(z)
    assert np.abs(z.mean(axis=0)).max() < 5 / np.sqrt(draws)
    assert np.abs((z**2).mean(axis=0) - 1).max() < 5 * np.sqrt(2 / draws)


def test_identification_of_an_arm_within_its_standard_errors():
    """Two torques of different noise: 200 records, each estimated with its own standard errors."""
    model = compiled(arm())
    states = np.random.default_rng(7).uniform(-3, 3, (3, 150, 2))
    W, names = model.regressor(0, *states, P)
    tau, pi = model.inverse_dynamics(0, *states, P), model.inertial_parameters(P)
    known = {name: pi[name] for name in names if name != "loads"}
    z, found = deviations(W[..., :-1], names[:-1], tau - W[..., -1], known, np.array([0.5, 0.05]))
    assert_standard(z)
    assert found.residuals == pytest.approx([0.5, 0.05], rel=0.3)
    exact = da.identify(W, names, tau, known={"lower.m": pi["lower.m"]}, sigma=[0.5, 0.05])
    assert "lower.m" not in exact.base.parameters and "loads" not in exact.base.parameters
    assert exact.values == pytest.approx(exact.base.values(pi), rel=1e-11)
    assert "upper.I_zz" in repr(exact)


@pytest.mark.parametrize("case", ["loop", "rolling", "loop with given torque"])
def test_identification_with_loops_and_rolling(case):
    rng = np.random.default_rng(8)
    if case == "rolling":
        model, p = rolling()
        states, u = driven_states(model, p, rng, 200)
    else:
        model, p = compiled(slider()), P
        pairs = [on_loop(*pair) for pair in rng.uniform([-3, 1], [3, 4], (200, 2))]
        q, qdot = (np.array(part) for part in zip(*pairs, strict=True))
        u = rng.uniform(-40, 40, (200, 1))
        qddot = [model.accelerations(0, *s[:2], p, inputs={"u": s[2][0]}) for s in zip(q, qdot, u, strict=True)]
        states = q, qdot, np.array(qddot)
    pi = model.inertial_parameters(p)
    if case == "loop with given torque":  # noise of the torque, in three rows that depend on each other
        t = np.arange(200.0)
        W, names = model.regressor(t, *states, p, inputs={"u": da.samples(t, u[:, 0], kind="hold")})
        load, W = W[..., -1], W[..., :-1]
        base, z = da.base_parameters(W, names[:-1]), []
        for _ in range(200):
            noisy = load * (1 + rng.normal(size=(200, 1)) * 0.5 / u)
            found = da.identify(W, names[:-1], -noisy, base=base)
            z.append((found.values - base.values(pi)) / found.errors)
    else:
        z, found = deviations(*model.regressor(0, *states, p), u, pi, 0.1)
    assert_standard(np.array(z))
    assert len(found.values) > (2 if case == "rolling" else 4)


def test_consistent_bodies_where_least_squares_have_none():
    """Few noisy samples: estimates of all parameters are bodies, and fit as well as the noise allows."""
    model = compiled(arm(damping=False))
    states = np.random.default_rng(9).normal(size=(3, 30, 2))
    W, names = model.regressor(0, *states, P)
    pi = model.inertial_parameters(P)
    for body in ("upper", "lower"):
        pi |= {f"{body}.I_xx": 0.02, f"{body}.I_yy": pi[f"{body}.I_zz"]}
    rng = np.random.default_rng(10)
    tau = W @ np.array(list(pi.values())) + rng.normal(size=(30, 2))
    guess = {name: 1.6 * value for name, value in pi.items()}
    found = da.identify_bodies(W, names, tau, guess, sigma=1.0)
    bodies = da.body_inertias(found)
    assert list(bodies) == ["upper", "lower"] and all(body.consistent for body in bodies.values())
    base = da.base_parameters(W, names)
    best = da.identify(W, names, tau, base=base)
    left = tau - W @ np.array([found[name] for name in names])
    assert np.sum(left**2) < np.sum((tau - base.reduce(W) @ best.values) ** 2) + 10
    far = {name: 1.6 * value for name, value in found.items()}
    assert da.identify_bodies(W, names, tau, far, sigma=1.0, spread=1e-6) == pytest.approx(far, rel=1e-4, abs=1e-6)


def test_bodies_of_ten_parameters():
    """A plate, a rod that is too thin to be one, and a body of negative mass."""
    plate = BodyInertia.of(np.array([2.0, 0.2, 0, 0, 1, 0, 0, 1 + 0.02, 0, 2 + 0.02]))
    assert plate.centre == pytest.approx([0.1, 0, 0]) and np.diag(plate.inertia) == pytest.approx([1, 1, 2])
    assert plate.least == pytest.approx(0, abs=1e-15) and plate.consistent == (plate.least >= 0)
    for moments, mass in (((1, 1, 2.1), 2.0), ((1, 1, 1), -2.0), ((1, 1, 1), 0.0)):
        assert not BodyInertia.of(np.array([mass, 0, 0, 0, moments[0], 0, 0, moments[1], 0, moments[2]])).consistent


def test_excitation_is_the_best_of_a_sweep():
    model = compiled(arm())
    options = {"limits": [[-1, 2], [-1.5, 1.5]], "rates": [4, 3], "samples": 40}
    one, best = (da.design_excitation(model, P, cases=n, **options) for n in (1, 60))
    t = np.linspace(0, 10, 1001)
    q, qdot, qddot = best(t)
    assert best.condition < one.condition
    assert np.all(q.min(axis=0) >= [-1.001, -1.501]) and np.all(q.max(axis=0) <= [2.001, 1.501])
    used = np.maximum((q.max(axis=0) - q.min(axis=0)) / 3, np.abs(qdot).max(axis=0) / [4, 3])
    assert used == pytest.approx([1, 1], abs=0.01) and q[0] == pytest.approx(q[-1], abs=1e-12)
    assert np.gradient(q, t, axis=0)[5:-5] == pytest.approx(qdot[5:-5], abs=1e-2)
    assert np.gradient(qdot, t, axis=0)[5:-5] == pytest.approx(qddot[5:-5], abs=1e-2)


# -- refusals --------------------------------------------------------------------------------------


def test_what_is_wrong_is_said(tmp_path):
    model = compiled(arm())
    states = np.random.default_rng(11).normal(size=(3, 30, 2))
    W, names = model.regressor(0, *states, P)
    tau = model.inverse_dynamics(0, *states, P)
    with pytest.raises(ValueInputError, match=r"q must have shape \(2,\) or \(k, 2\)"):
        model.regressor(0, [1, 2, 3], [0, 0], [0, 0], P)
    with pytest.raises(CapabilityError, match=r"'g' is no column of a regressor: no load depends on it"):
        model.regressor(0, *states, P, loads=["g"])
    with pytest.raises(UnknownNameError, match="friction"):
        model.regressor(0, *states, P, loads=["friction"])
    with pytest.raises(ValueInputError, match=r"W must have shape \(..., 3\)"):
        da.base_parameters(W, names[:3])
    with pytest.raises(ValueInputError, match="W is zero"):
        da.base_parameters(0 * W, names)
    with pytest.raises(ValueInputError, match="not finite"):
        da.base_parameters(np.nan * W, names)
    with pytest.raises(ValueInputError, match=r"measured must have the shape \(30, 2\)"):
        da.identify(W, names, tau[:, 0])
    with pytest.raises(UnknownNameError, match=r"known: .*upper\.mass"):
        da.identify(W, names, tau, known={"upper.mass": 1})
    with pytest.raises(ValueInputError, match=r"sigma must be a positive number, or one for each of the 2 rows"):
        da.identify(W, names, tau, sigma=[1, 0])
    with pytest.raises(ValueInputError, match=r"the record determines 2 of 6 base parameters"):
        da.identify(W[:1], names, tau[:1], base=da.base_parameters(W[..., :-1], names[:-1]))
    with pytest.raises(ValueInputError, match="base is of other parameters"):
        da.identify(W, names, tau, base=da.base_parameters(W, names))
    with pytest.raises(ValueInputError, match=r"start: 'upper' is no body: its mass is 2, its least second moment"):
        da.identify_bodies(W, names, tau, model.inertial_parameters(P))
    with pytest.raises(UnknownNameError, match=r"start has no values of upper\.m"):
        da.identify_bodies(W, names, tau, {})
    with pytest.raises(OptionError, match="limits must be finite"):
        da.design_excitation(model, P, limits=(1, -1))
    with pytest.raises(CapabilityError, match=r"has constraints, .* sweep their coefficients"):
        da.design_excitation(compiled(slider()), P, limits=(-1, 1))
    q, qd = on_loop(0.8, 3.0)
    with pytest.raises(ValueInputError, match="several values of the inputs u, f do the same"):
        compiled(slider(both=True)).regressor(0, q, qd, [0, 0, 0], P)


def test_forces_that_are_no_loads_are_refused():
    """Regularised friction is a force in the equations, and no load of the scene."""
    x, T, plane, origin = dynamicsymbols("x"), da.unknowns("T"), ReferenceFrame("N"), Point("O")
    block = Particle("block", origin.locatenew("B", x * plane.x), 2)
    scene = da.Scene("block", frame=plane, origin=origin, coordinates=[x])
    scene.add_bodies(block)
    scene.add_joints(da.Joint("guide", body="block", at=block.masscenter, force=T * plane.x))
    scene.add_friction(da.CoulombFriction(normal=4, tangential=T, slip=x.diff(), mu=1, regularization=0.01, name="rub"))
    model = compiled(scene)
    assert model.inverse_dynamics(0, [0], [1], [3], {}) == pytest.approx([2 * 3 + 4 / np.sqrt(1 + 1e-4)], rel=1e-12)
    with pytest.raises(CapabilityError, match=r"forces that are neither inertia nor loads .* regularised friction"):
        model.regressor(0, [0], [1], [3], {})
