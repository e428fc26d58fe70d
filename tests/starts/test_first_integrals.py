"""`trajectory.invariants`: what the equations conserve, and nothing else."""

import numpy as np
import pytest

import dalembert as da
from dalembert.errors import OptionError, PrecisionWarning
from hard_cases import hard_case

CONSERVED = {
    "sleigh through theta = pi/2": {"energy"},
    "sleigh, b = 0": {"energy", "p_theta"},
    "sphere, 3-1-3 angles": {"energy", "p_x", "p_y", "p_psi", "p_phi"},
    "sphere on an incline": {"energy", "p_y", "p_psi"},
    "sphere on a turntable": set(),
    "heavy top, slow precession": {"energy"},
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
