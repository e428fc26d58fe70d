"""`project_invariants`: integrals keep their values, with the constraints, in single and prepared runs and sweeps."""

from functools import cache

import numpy as np
import pytest
from sympy import Abs, Max, Min, Piecewise, Rational, exp, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import EnergyWarning, FormulationError, OptionError, UnknownNameError
from dalembert.starts import first_integrals
from hard_cases import hard_case

LOOSE = {"rtol": 1e-6, "atol": 1e-8}
KEPT = [
    ("double pendulum, angles", "minimal", {"energy"}, 20.0),
    ("double pendulum, Cartesian", "projected", {"energy"}, 20.0),
    ("heavy top, fast precession", "minimal", {"energy", "p_omega_N_z", "p_omega_S_z"}, 10.0),
    ("heavy top, fast precession", "projected", {"energy", "p_omega_N_z", "p_omega_S_z"}, 10.0),
    ("sleigh, b = 0", "projected", {"energy", "p_theta"}, 100.0),
    ("edge plate falling flat", "projected", {"energy", "p_x", "p_y", "p_psi"}, 0.5),
    ("knife edge on an incline", "minimal", {"energy", "p_phi"}, 20.0),
    ("slider-crank", "projected", {"energy"}, 2.0),
]
METHODS = ("taylor", "dop853", "tsit5", "radau")
RUNS = [(*case, METHODS[i % len(METHODS)]) for i, case in enumerate(KEPT)]
RUNS += [(*KEPT[1], method) for method in METHODS if method != METHODS[1]]
"""Every scene by one method, and one scene by all: how a method corrects is the same for all scenes."""


@cache
def model_of(name, formulation, backend="llvm"):
    return da.compile_model(hard_case(name).scene, formulation=formulation, backend=backend)


def simulate(name, formulation, end, backend="llvm", **options):
    case = hard_case(name)
    options = LOOSE | options
    return model_of(name, formulation, backend).simulate((0.0, end), case.initial, case.parameters, **options)


def change(run):
    return max(np.max(np.abs(x - x[0])) / max(1.0, abs(x[0])) for x in run.invariants.values())


@pytest.mark.parametrize(("name", "formulation", "names", "end", "method"), RUNS)
def test_they_are_kept_together_with_the_constraints(name, formulation, names, end, method):
    run = simulate(name, formulation, end, method=method, project_invariants=True)
    assert run.success, run.message
    assert set(run.invariants) == names
    size = max(1.0, float(np.max(np.abs(run.qdot))))
    assert change(run) < 1e-11 * size
    assert np.max(np.abs(run.constraint_violation), initial=0.0) < 1e-13 * size
    assert np.max(np.abs(run.velocity_violation), initial=0.0) < 1e-12 * size


@pytest.mark.parametrize(("name", "formulation", "names", "end", "method"), RUNS)
def test_the_motion_stays_within_its_error(name, formulation, names, end, method):
    """The correction is as small as what it corrects; both runs differ from a tight one by as much."""
    end = min(end, 5.0)
    tight = simulate(name, formulation, end, rtol=1e-13, atol=1e-15, t_eval=[end])
    gaps = [
        np.max(np.abs(simulate(name, formulation, end, method=method, project_invariants=keep).q[-1] - tight.q[-1]))
        for keep in (False, True)
    ]
    assert gaps[1] < 3 * gaps[0] + 1e-9


def test_one_of_them_by_name():
    run = simulate("edge plate falling flat", "projected", 0.5, method="dop853", project_invariants="p_psi")
    drift = {name: np.max(np.abs(x - x[0])) for name, x in run.invariants.items()}
    assert drift["p_psi"] < 1e-14 < 1e-9 < drift["energy"]


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_continuous_output_meets_the_steps_and_keeps_them_too(method):
    run = simulate("double pendulum, Cartesian", "projected", 5.0, method=method, project_invariants=True)
    np.testing.assert_allclose(run(run.t).y, run.y, rtol=0, atol=1e-11)  # a correction leaves its square
    between = run(0.5 * (run.t[1:] + run.t[:-1]))
    assert change(between) < 1e-9
    assert np.max(np.abs(between.constraint_violation)) < 1e-10


@pytest.mark.parametrize("backend", ["numpy", "jax"])
def test_other_backends(backend):
    pytest.importorskip(backend)
    method = {"jax": "tsit5"}.get(backend, "auto")
    run = simulate("knife edge on an incline", "minimal", 5.0, backend, method=method, project_invariants=True)
    assert run.success and change(run) < 1e-11


def test_error_growth_of_a_pendulum():
    """Without it the period drifts with the energy, and the phase with the square of time."""
    case, end = hard_case("pendulum, Cartesian (IFToMM A01)"), 100.0
    exact = case.expected([end])[0][:2]
    gap = {
        keep: np.max(np.abs(simulate(
            "pendulum, Cartesian (IFToMM A01)", "projected", end, method="tsit5", rtol=1e-7, atol=1e-9,
            project_invariants=keep,
        ).q[-1] - exact))
        for keep in (False, True)
    }  # fmt: skip
    assert gap[True] < 0.2 * gap[False]


def test_at_rest_where_the_gradient_of_the_energy_vanishes():
    """Hanging still, and from rest at the top of the swing."""
    model, p = model_of("double pendulum, angles", "minimal"), hard_case("double pendulum, angles").parameters
    names = ("theta1", "theta2", "theta1_dot", "theta2_dot")
    still = model.simulate((0, 10), dict.fromkeys(names, 0.0), p, project_invariants=True)
    assert still.success and np.all(still.q == 0.0)
    run = model.simulate((0, 10), dict.fromkeys(names, 0.0) | {"theta1": 0.5}, p, project_invariants=True, **LOOSE)
    assert run.success and change(run) < 1e-11


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_sweeps_are_single_runs(method):
    """At a tolerance at which what the loops leave to the next correction is below rounding."""
    case = hard_case("edge plate falling flat")
    model, speeds = model_of("edge plate falling flat", "projected"), np.array([0.0, 0.1, np.nan, 0.4, 0.2])
    options = {"rtol": 1e-9, "atol": 1e-11, "method": method, "project_invariants": True}
    sweep = model.sweep((0, 0.3), {**case.initial, "x_dot": speeds}, case.parameters, reduce=["energy"], **options)
    assert sweep.status[2] != 0
    for i in (0, 1, 3, 4):
        run = model.simulate((0, 0.3), {**case.initial, "x_dot": speeds[i]}, case.parameters, **options)
        assert sweep.status[i] == 0
        assert change(run) < 1e-12
        np.testing.assert_allclose(sweep.reduced["energy"][i], run["energy"][0], rtol=1e-13)
        np.testing.assert_allclose([sweep.final[name][i] for name in ("theta", "psi_dot")],
                                   [run[name][-1] for name in ("theta", "psi_dot")], rtol=1e-11)  # fmt: skip


def test_neighbours_in_a_sweep_do_not_matter():
    case, model = hard_case("edge plate falling flat"), model_of("edge plate falling flat", "projected")
    speeds = np.linspace(0.0, 0.5, 9)

    def finals(some):
        sweep = model.sweep(
            (0, 0.3), {**case.initial, "x_dot": some}, case.parameters, method="taylor", project_invariants=True
        )
        return np.stack([sweep.final[name] for name in model.layout.state], axis=1)

    np.testing.assert_array_equal(finals(speeds)[3:5], finals(speeds[3:5]))


@pytest.mark.parametrize(
    ("name", "formulation", "method", "backend"),
    [
        ("double pendulum, Cartesian", "projected", "taylor", "llvm"),
        ("edge plate falling flat", "projected", "radau", "llvm"),
        ("knife edge on an incline", "minimal", "dop853", "numpy"),
    ],
)
def test_prepared_runs_are_single_runs(name, formulation, method, backend):
    case, model = hard_case(name), model_of(name, formulation, backend)
    options = LOOSE | {"method": method, "project_invariants": True}
    run = model.prepare((0, 0.5), **options)
    for scale in (1.0, 1.1):
        initial = {key: x * (scale if "dot" in str(key) else 1.0) for key, x in case.initial.items()}
        single = model.simulate((0, 0.5), initial, case.parameters, **options)
        found = run(model.state(initial, case.parameters), model.parameter_vector(case.parameters))
        assert run.status.success and run.method == method
        np.testing.assert_allclose(found, single.y[-1], rtol=1e-12, atol=1e-13)


def test_faults_of_prepared_runs():
    case = hard_case("sleigh, b = 0")
    with pytest.raises(UnknownNameError, match=r"unknown first integral 'enrgy'"):
        model_of("sleigh, b = 0", "projected").prepare((0, 1), project_invariants="enrgy")
    with pytest.raises(FormulationError, match="'augmented' do not"):
        model_of("sleigh, b = 0", "augmented").prepare((0, 1), project_invariants=True)
    model = model_of("sleigh, b = 0", "projected")
    lost = model.prepare((0, 1), project_invariants="p_x")
    with pytest.raises(OptionError, match="'p_x' is not conserved: constraints act along 'x'"):
        lost(model.state(case.initial, case.parameters), model.parameter_vector(case.parameters))


def test_grids():
    case, model = hard_case("edge plate falling flat"), model_of("edge plate falling flat", "projected")
    rest = {name: value for name, value in case.initial.items() if str(name) not in ("x_dot", "y_dot")}
    grid = da.grid(x_dot=np.array([0.0, 0.2]), y_dot=np.array([0.0, 0.1, 0.3]))
    sweep = model.sweep((0, 0.3), rest, case.parameters, grid=grid, project_invariants=["energy"])
    assert np.all(sweep.status == 0) and len(sweep.status.ravel()) == 6


def test_what_was_chosen_is_explained():
    keepers = model_of("edge plate falling flat", "projected").variants.invariant_models
    if not keepers():
        simulate("edge plate falling flat", "projected", 0.1, project_invariants=True)
    text = keepers()[0].explain()
    assert "kept at their initial values after every step: " in text


# -- what is refused ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "wanted", "why"),
    [
        ("stiff flyball governor", "energy", r"'energy' is not conserved: forces without a potential energy"),
        (
            "car axis",
            True,
            r"nothing is known to be conserved .* constraints that depend on time do work: hol",
        ),
        ("edge plate falling flat", "p_theta", r"'p_theta' is not conserved: constraints act along|a force acts along"),
        ("heavy top, fast", "p_omega_N_x", r"'p_omega_N_x' is not conserved: a force acts along 'omega_N_x'"),
        ("sphere with unequal moments", "p_omega_N_x", r"constraints act along 'omega_N_x': nonholonomic"),
        ("knife edge on an incline", ["p_x"], r"'p_x' is not conserved: constraints act along 'x': nonholonomic"),
    ],
)
@pytest.mark.parametrize("how", ["simulate", "sweep"])
def test_what_is_not_conserved_is_refused_with_the_reason(name, wanted, why, how):
    case = hard_case(name)
    with pytest.raises(OptionError, match=why):
        getattr(model_of(name, "auto", "numpy"), how)((0, 1), case.initial, case.parameters, project_invariants=wanted)


def test_unknown_names():
    with pytest.raises(UnknownNameError, match=r"unknown first integral 'enrgy'.*Did you mean 'energy'"):
        simulate("sleigh, b = 0", "projected", 1.0, project_invariants=["enrgy"])


@pytest.mark.parametrize("wanted", [[], None])
def test_no_names(wanted):
    with pytest.raises(OptionError, match=r"no first integral is named.* Conserved in .*: energy"):
        simulate("sleigh, b = 0", "projected", 1.0, project_invariants=wanted)


@pytest.mark.parametrize("formulation", ["baumgarte", "ggl", "augmented"])
def test_formulations_that_do_not_project(formulation):
    with pytest.raises(FormulationError, match=rf"'{formulation}' do not.*minimal"):
        simulate("sleigh, b = 0", formulation, 1.0, project_invariants=True)


def test_jumps():
    event = da.Event("theta1", apply={"theta1_dot": "-theta1_dot"}, name="bounce")
    with pytest.raises(OptionError, match="jumps at the events bounce"):
        simulate("double pendulum, angles", "minimal", 1.0, events=[event], project_invariants=True)


def test_contacts():
    scene = da.scenes.bouncing_ball()
    model = da.compile_model(scene, backend="numpy")
    for how in (model.simulate, model.sweep):
        with pytest.raises(OptionError, match="friction takes energy, and impacts"):
            how((0, 1), {}, {}, project_invariants=True)


_t = dynamicsymbols._t
_x, _y = dynamicsymbols("x y")
LATER = {
    "a force of time that begins at zero": sin(_t),
    "a force of time that ends": exp(-1000 * (_t - 2) ** 2),
    "a damper that begins later": Piecewise((-_x.diff(), _t > 1), (0, True)),
    "a damper beyond a stop": -Max(0, _x - Rational(1, 2)) * _x.diff(),
    "a saturated damper far away": -Max(0, Min(_x - 50, 1)) * _x.diff(),
    "a saturated spring with one": -Max(0, Min(_x, 1)) - Max(0, Min(_x - 50, 1)) * _x.diff(),
    "a damper far away": -exp(-300 * (_x - 3) ** 2) * _x.diff(),
    "a brake by a table": da.table(_x.diff(), [0, 1, 2], [0, 0, -3], "linear", extrapolate="linear"),
}
SPRINGS = {
    "bumper": -9 * Max(0, _x - Rational(1, 2)),
    "two stops": -5 * (Max(0, _x - 0.3) - Max(0, -0.3 - _x)),
    "steps": -Piecewise((1, _x > 0.5), (2, _x > 0.3), (0, True)),
    "saturated spring": -3 * Max(0, Min(_x, 0.1)),
    "saturated both ways": -3 * Min(Max(-0.1, _x), 0.1),
    "switches in switches": -Max(-2, Min(3 * Max(_x, -0.1), 0.2), _x),
    "square of a switch": -(Max(0, Min(_x, 0.1)) ** 2),
    "two wells": -Abs(Abs(_x) - 0.1),
    "stiffer outside": -Abs(_x) * _x,
    "table": -da.table(_x, [-2, 0, 0.5, 1, 2], [-1, 0, 0, 2, 3], "cubic"),
    "magnet": 2 * (_x - 1) * exp(-50 * (_x - 1) ** 2),
}


def bead(force, *constraints):
    frame, origin = ReferenceFrame("N"), Point("O")
    scene = da.Scene("bead", frame=frame, origin=origin, coordinates=[_x, _y])
    place = origin.locatenew("P", _x * frame.x + _y * frame.y)
    scene.add_bodies(Particle("bead", place, 1))
    scene.add_loads((place, force * frame.x), (place, -4 * place.pos_from(origin)))
    scene.add_holonomic_constraints(*constraints)
    return da.compile_model(scene, backend="numpy")


BEAD = {"x": 0, "y": 1, "x_dot": 0.2, "y_dot": 0}
RING = _x**2 + _y**2 - 1


@pytest.mark.parametrize("constraints", [(), (RING,)])
@pytest.mark.parametrize("name", LATER)
def test_what_takes_energy_later_or_elsewhere_counts(name, constraints):
    model = bead(LATER[name], *constraints)
    with pytest.raises(OptionError, match="'energy' is not conserved"):
        model.simulate((0, 1e-3), BEAD, {}, project_invariants="energy")
    assert "energy" not in model.simulate((0, 1e-3), BEAD, {}).invariants


@pytest.mark.parametrize("name", SPRINGS)
def test_springs_with_branches_keep_energy(name):
    run = bead(SPRINGS[name], RING).simulate((0, 0.5), BEAD | {"x_dot": 3}, {}, project_invariants="energy")
    assert run.success
    np.testing.assert_allclose(run["energy"], run["energy"][0], rtol=1e-9)


SATURATED = -Max(0, Min(_x, 1))
POTENTIALS = {
    "derived": None,
    "by cases": Piecewise((0, _x < 0), (_x**2 / 2, _x < 1), (_x - Rational(1, 2), True)),
    "by powers": Max(0, _x) ** 2 / 2 - Max(0, _x - 1) ** 2 / 2,
}
"""Potential energies of a spring that pulls towards x = 0 with at most the force 1, and none before that."""


@pytest.mark.parametrize("declared", POTENTIALS)
def test_a_saturated_spring_in_closed_form(declared):
    """v is constant, then x = v sin t up to 1, then there is a constant deceleration; and back."""
    frame, origin, speed = ReferenceFrame("N"), Point("O"), 1.5
    scene = da.Scene("saturated", frame=frame, origin=origin, coordinates=[_x])
    place = origin.locatenew("P", _x * frame.x)
    mass = Particle("mass", place, 1)
    if POTENTIALS[declared] is not None:
        mass.potential_energy = POTENTIALS[declared]
    scene.add_bodies(mass)
    scene.add_loads((place, SATURATED * frame.x))
    begin, inside = 0.5, float(np.arcsin(1 / speed))
    beyond = speed * np.cos(inside)  # the speed at x = 1
    end = begin + 2 * inside + 2 * beyond
    moments = [begin, begin + inside, begin + inside + beyond, end, end + 1]
    model = da.compile_model(scene, backend="numpy")
    options = {"rtol": 1e-8, "atol": 1e-10, "t_eval": moments, "project_invariants": "energy"}
    run = model.simulate((0, end + 1), {"x": -speed * begin, "x_dot": speed}, {}, **options)
    assert run.success, run.message
    np.testing.assert_allclose(run["x"], [0, 1, 1 + beyond**2 / 2, 0, -speed], atol=1e-6)
    np.testing.assert_allclose(run["x_dot"], [speed, beyond, 0, -speed, -speed], atol=1e-6)
    np.testing.assert_allclose(run["energy"], run["energy"][0], rtol=1e-12)


def test_a_declared_potential_that_is_not_that_of_the_load_is_not_conserved():
    """The force saturates at 1, the potential energy beyond 100 does not."""
    frame, origin = ReferenceFrame("N"), Point("O")
    scene = da.Scene("saturated", frame=frame, origin=origin, coordinates=[_x])
    place = origin.locatenew("P", _x * frame.x)
    mass = Particle("mass", place, 1)
    mass.potential_energy = POTENTIALS["by cases"] + Max(0, _x - 100) ** 2
    scene.add_bodies(mass)
    scene.add_loads((place, SATURATED * frame.x))
    with pytest.warns(EnergyWarning, match="is not that of their loads"):
        model = da.compile_model(scene, backend="numpy")
    with pytest.raises(OptionError, match="'energy' is not conserved"):
        model.simulate((0, 1), {"x": 0.5, "x_dot": 0}, {}, project_invariants="energy")


@pytest.mark.parametrize("force", [-_x.diff(), -Max(0, _x - 5) * _x.diff()])
def test_a_case_that_does_not_conserve_what_the_first_does(force):
    share = symbols("share")
    model = bead(share * force)
    values = BEAD, {share: np.array([0.0, 0.0, 0.003])}
    with pytest.raises(OptionError, match="'energy' is not conserved in case 2, but is in the first"):
        model.sweep((0, 1), *values, project_invariants=True)
    assert model.sweep((0, 1), BEAD, {share: np.zeros(2)}, project_invariants=True).success.all()
    run, state = model.prepare((0, 1), project_invariants=True), model.state(BEAD, {share: 0})
    assert np.all(np.isfinite(run(state, model.parameter_vector({share: 0.0}))))
    with pytest.raises(OptionError, match="'energy' is not conserved with these parameters"):
        run(state, model.parameter_vector({share: 0.003}))


def test_what_is_conserved_is_found_out_once_for_parameters(monkeypatch):
    share = symbols("share")
    model, keep = bead(-share * _x.diff()), {"project_invariants": True}
    first = model.sweep((0, 1), BEAD, {share: np.zeros(2)}, **keep)
    with monkeypatch.context() as patch:
        patch.setattr(first_integrals, "_still", None)
        again = model.sweep((0, 1), BEAD, {share: np.zeros(2)}, **keep)
        others = model.sweep((0, 1), {**BEAD, "x_dot": np.array([1.0, 2.0])}, {share: 0}, **keep)
        with pytest.raises(TypeError):
            model.sweep((0, 1), BEAD, {share: np.full(2, 0.003)}, **keep)
    np.testing.assert_array_equal(again.final["x"], first.final["x"])
    assert others.success.all()
    with pytest.raises(OptionError, match="nothing is known to be conserved"):
        model.sweep((0, 1), BEAD, {share: np.full(2, 0.003)}, **keep)


def test_many_cases_start_as_few_do():
    """Values to keep are those of compiled code in lanes, whatever stands beside a case."""
    case, model = hard_case("edge plate falling flat"), model_of("edge plate falling flat", "projected")
    speeds = np.linspace(0.0, 0.5, 21)
    many, few = (
        model.sweep((0, 1e-3), {**case.initial, "x_dot": some}, case.parameters, project_invariants=True)
        for some in (speeds, speeds[13:14])
    )
    for name in model.layout.state:
        assert many.final[name][13] == few.final[name][0]
