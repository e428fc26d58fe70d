"""`trajectory.invariants`: what the equations conserve, and nothing else."""

import numpy as np
import pytest
from sympy import sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import OptionError, PrecisionWarning
from hard_cases import hard_case

CONSERVED = {
    "sleigh through theta = pi/2": {"energy"},
    "sleigh, b = 0": {"energy", "p_theta"},
    "sphere, 3-1-3 angles": {"energy", "p_x", "p_y", "p_psi", "p_phi"},
    "sphere on an incline": {"energy", "p_y", "p_psi"},
    "sphere on a turntable": {"p_omega_N_z"},
    "sphere with unequal moments": {"energy", "p_omega_N_z"},
    "heavy top, slow precession": {"energy", "p_omega_N_z", "p_omega_S_z"},
    "free body near its unstable axis": {"energy", "p_omega_N_x", "p_omega_N_y", "p_omega_N_z"},
    "Suslov body": {"energy"},
    "vertical disk": {"energy", "p_phi", "p_theta"},
    "edge plate falling flat": {"energy", "p_x", "p_y", "p_psi"},
    "knife edge on an incline": {"energy", "p_phi"},
    "Andrews' squeezing mechanism": {"energy"},
    "car axis": set(),
    "stiff flyball governor": {"p_phi"},
}


@pytest.mark.parametrize("name", CONSERVED)
def test_names_and_values(name):
    case = hard_case(name)
    model = da.compile_model(case.scene, backend="numpy")
    run = model.simulate((0, case.times()[0]), case.initial, case.parameters, rtol=1e-10, t_eval=[0.0, case.times()[0]])
    assert set(run.invariants) == CONSERVED[name]
    for values in run.invariants.values():
        assert values.shape == run.t.shape
        assert np.max(np.abs(values - values[0])) <= 1e-7 * max(1.0, abs(values[0]))


def hoop(angle, gravity=(0, 0, 1), damper=0):
    """A bead on a hoop that turns about its vertical diameter N.z by a function of time."""
    theta = dynamicsymbols("theta")
    m, r, g = symbols("m r g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    H = N.orientnew("H", "Axis", (angle, N.z))
    R = H.orientnew("R", "Axis", (theta, H.y))
    bead = O.locatenew("bead", -r * R.z)
    scene = da.Scene("hoop", frame=N, origin=O, coordinates=[theta])
    scene.add_bodies(Particle("bead", bead, m))
    scene.add_loads((bead, damper * theta.diff() * R.x))
    scene.apply_uniform_gravity(-g * sum((a * axis for a, axis in zip(gravity, N, strict=True)), start=0 * N.x))
    return scene


T, W = dynamicsymbols._t, symbols("w")
BEAD = {"theta": 0.4, "theta_dot": 1.0}, {"m": 1.2, "r": 0.8, "w": 4.0, "g": 9.81}


def test_jacobis_integral_of_a_bead_on_a_hoop():
    """m r^2 (theta'^2 - w^2 sin^2 theta) / 2 - m g r cos theta; the motor does work, so that the energy changes."""
    model = da.compile_model(hoop(W * T), backend="numpy")
    run = model.simulate((0, 5), *BEAD, rtol=1e-11)
    theta, rate = run["theta"], run["theta_dot"]
    expected = 0.5 * 1.2 * 0.8**2 * (rate**2 - 4.0**2 * np.sin(theta) ** 2) - 1.2 * 9.81 * 0.8 * np.cos(theta)
    assert set(run.invariants) == {"jacobi"} and np.ptp(run["energy"]) > 1.0
    np.testing.assert_allclose(run.invariants["jacobi"], expected, rtol=0, atol=1e-13)
    assert np.ptp(expected) < 1e-9
    kept = model.simulate((0, 5), *BEAD, rtol=1e-5, project_invariants=True)
    assert np.ptp(kept.invariants["jacobi"]) < 1e-12
    with pytest.raises(
        OptionError, match=r"'energy' is not conserved: prescribed motions .* Conserved in 'hoop': jacobi"
    ):
        model.simulate((0, 5), *BEAD, project_invariants="energy")


@pytest.mark.parametrize(
    "changed",
    [
        {"angle": W * T**2},
        {"angle": W * T, "gravity": (0.6, 0, 0.8)},
        {"angle": W * T, "damper": 0.3},
        {"angle": symbols("w") * sin(T)},
    ],
    ids=["faster and faster", "tilted", "damped", "to and fro"],
)
def test_jacobis_integral_is_not_claimed_where_it_changes(changed):
    run = da.compile_model(hoop(**changed), backend="numpy").simulate((0, 0.5), *BEAD)
    assert not run.invariants


def test_a_hoop_at_rest_has_its_energy_alone():
    model = da.compile_model(hoop(W), backend="numpy")
    assert set(model.simulate((0, 0.5), *BEAD).invariants) == {"energy"}
    assert "jacobi" not in model.derived.invariants.names


def test_two_tops_have_angular_momenta_of_their_own():
    """Both turn in the same frame, so that their vertical angular momenta have one name without the coordinates."""
    g = symbols("g")
    N, O = ReferenceFrame("N"), Point("O")
    quaternions = [dynamicsymbols(f"{name}0:4") for name in "ab"]
    scene = da.Scene("tops", frame=N, origin=O, coordinates=[x for e in quaternions for x in e])
    for name, e, other in zip("AB", quaternions, (0.1, 0.2), strict=True):
        S = N.orientnew(name, "Quaternion", e)
        G = O.locatenew(f"G{name}", 0.5 * S.z)
        scene.add_bodies(RigidBody(name, G, S, 1, (inertia(S, 0.1, other, 0.05), G)))
        scene.add_holonomic_constraints(sum(x**2 for x in e) - 1)
    scene.apply_uniform_gravity(-g * N.z)
    start = {"a0": 0.8, "a1": 0.6, "a2": 0, "a3": 0, "b0": 0.6, "b1": 0, "b2": 0.8, "b3": 0}
    start |= {f"{name}_dot": 0 for name in start} | {"a2_dot": 0.4, "b1_dot": 0.8, "b3_dot": 1.5}
    run = da.compile_model(scene, backend="numpy").simulate((0, 1), start, {"g": 9.81}, rtol=1e-9)
    whole = {"energy", "p_omega_A_z", "p_omega_N_z", "p_omega_N_z of b0, b1, b2, b3"}
    assert set(run.invariants) == whole  # the second is not symmetric
    for values in run.invariants.values():
        assert np.ptp(values) < 1e-6 and np.any(np.abs(values) > 0.01)


@pytest.mark.parametrize("formulation", ["minimal", "projected", "augmented"])
def test_formulations_conserve_the_same(formulation):
    case = hard_case("edge plate falling flat")
    model = da.compile_model(case.scene, backend="numpy", formulation=formulation)
    run = model.simulate((0, 0.3), case.initial, case.parameters, rtol=1e-10)
    assert set(run.invariants) == CONSERVED["edge plate falling flat"]
    np.testing.assert_allclose(run.invariants["energy"], run["energy"], rtol=1e-14)
    np.testing.assert_allclose(run.invariants["p_x"], 1.3 * run["x_dot"], rtol=1e-14)


def test_they_are_those_of_the_textbook_view():
    scene = da.scenes.edge_plate()
    found = {str(integral.name) for integral in da.lagrange(scene).first_integrals}
    assert {f"momentum of {name}" for name in ("x", "y", "psi")} <= found


def test_a_motion_evaluated_elsewhere_has_them_too():
    case = hard_case("knife edge on an incline")
    run = da.compile_model(case.scene, backend="numpy").simulate((0, 1), case.initial, case.parameters)
    assert set(run(np.array([0.3, 0.4])).invariants) == {"energy", "p_phi"}


def test_a_motion_without_a_scene_says_so():
    case = hard_case("knife edge on an incline")
    run = da.compile_model(case.scene, backend="numpy").simulate((0, 1), case.initial, case.parameters)
    run.parts[0].monitors = None
    with pytest.raises(OptionError, match="has no scene"):
        _ = run.invariants


@pytest.fixture(scope="module")
def model():
    return da.compile_model(hard_case("knife edge on an incline").scene)


class TestTolerances:
    """Less than double precision gives is asked for with a warning, never in silence."""

    def run(self, model, how, **tolerances):
        case = hard_case("knife edge on an incline")
        if how == "prepare":
            return model.prepare((0, 1e-3), **tolerances)
        return getattr(model, how)((0, 1e-3), case.initial, case.parameters, **tolerances)

    @pytest.mark.parametrize("how", ["simulate", "sweep", "prepare"])
    def test_below_the_floor(self, model, how):
        with pytest.warns(PrecisionWarning, match=r"rtol = 1e-18 with atol = 1e-20 .* its floor is 1e-16"):
            self.run(model, how, rtol=1e-18, atol=1e-20)

    @pytest.mark.parametrize("how", ["simulate", "sweep", "prepare"])
    @pytest.mark.parametrize("tolerances", [{"rtol": 1e-16, "atol": 0.0}, {"rtol": 0.0, "atol": 1e-9}])
    def test_at_the_floor_and_above(self, model, how, tolerances, recwarn):
        self.run(model, how, **tolerances)
        assert not [w for w in recwarn if issubclass(w.category, PrecisionWarning)]
