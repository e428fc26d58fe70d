"""Published benchmarks beside the table of hard cases: linkages, a linear model, and a flexible slider-crank."""

from functools import cache

import numpy as np
import pytest
from sympy import symbols

import dalembert as da
from dalembert.methods.status import Status
from hard_cases.case import published_reference
from hard_cases.flexible_crank import flexible_crank
from hard_cases.linkages import (
    SPRING_LINKAGE,
    bricard,
    forty_windows,
    level_windows,
    linear_benchmark,
    spring_linkage_scene,
)

DRIFTING = {"augmented": 200.0, "baumgarte": 200.0}


@cache
def case_of(build):
    return build()


@cache
def model_of(build, formulation, backend="llvm"):
    return case_of(build).compile(formulation, backend)


@pytest.mark.parametrize("formulation", ["auto", "projected", "baumgarte", "augmented"])
def test_bricard_over_two_periods(formulation):
    case = case_of(bricard)
    run = case.simulate(model_of(bricard, formulation))
    assert run.success and "follows from the others around the start" in run.message, run.message
    assert case.error(run) <= case.bound * DRIFTING.get(formulation, 1.0)
    assert case.change(run) <= 1e-12 * DRIFTING.get(formulation, 1.0)


def test_bricard_by_an_implicit_method():
    case = case_of(bricard)
    run = case.simulate(model_of(bricard, "ggl"), rtol=1e-10, atol=1e-12)
    assert run.success, run.message
    assert case.error(run) <= 1e-8


def test_bricard_and_a_published_sum_of_coordinates():
    """Exudyn's test adds dof, redundant constraints and the norm of displacements and changes of Euler parameters.

    At 1 s, its implicit steps of 1 ms give 4.172189649307425 (TestModels/bricardMechanism.py), that norm plus two.
    """
    case, a = case_of(bricard), symbols("a1:6")
    run = model_of(bricard, "projected").simulate((0.0, 1.0), case.initial, case.parameters, rtol=1e-12, t_eval=[0, 1])
    angles = dict(zip(a, run.q[-1], strict=True))
    assert np.sqrt(sum(_moved(list(angles.values())))) + 2 == pytest.approx(4.172189649307425, abs=2e-6)


def _moved(angles):
    """Return the squares of displacements of the rods' first ends, and of the changes of their Euler parameters."""
    from hard_cases.linkages import AXES, CORNERS

    first = [("z", 0.0), ("z", -np.pi / 2), ("y", -np.pi / 2), ("z", np.pi), ("z", np.pi / 2)]
    turn, place, found = np.array([1.0, 0, 0, 0]), np.zeros(3), []
    for i, (axis, angle) in enumerate(zip(AXES, angles, strict=True)):
        found.append(float(np.sum((place - CORNERS[i]) ** 2)))
        turn = _product(turn, _about(axis, angle))
        before = _about(*first[i])
        after = _product(turn, before)
        found.append(min(float(np.sum((after - sign * before) ** 2)) for sign in (1, -1)))
        arm = np.subtract(CORNERS[i + 1], CORNERS[i])
        place = place + _product(_product(turn, np.array([0.0, *arm])), turn * [1, -1, -1, -1])[1:]
    return found


def _about(axis, angle):
    found = np.zeros(4)
    found[0], found[1 + "xyz".index(axis)] = np.cos(angle / 2), np.sin(angle / 2)
    return found


def _product(a, b):
    return np.array([a[0] * b[0] - a[1:] @ b[1:], *(a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:]))])


@pytest.mark.matrix
def test_forty_windows_up_to_the_first_singular_position():
    """At 0.7216 s the cranks lie down."""
    case = case_of(forty_windows)
    run = case.simulate(model_of(forty_windows, "projected"), method="dop853")
    assert run.success, run.message
    assert case.error(run) <= case.bound


@pytest.mark.parametrize("formulation", ["projected", "augmented"])
def test_forty_windows_whose_bars_do_not_turn(formulation):
    """80 conditions of rank 40: one of each pair vanishes at every quarter turn, and the rank stays."""
    case = case_of(level_windows)
    run = case.simulate(model_of(level_windows, formulation))
    assert run.success and "enforced together with the others" in run.message
    assert case.error(run) <= case.bound * DRIFTING.get(formulation, 1.0)
    assert case.change(run) <= 1e-11 * DRIFTING.get(formulation, 1.0)


@pytest.mark.parametrize("end", [1.0, 4.0])
@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-12])
def test_forty_windows_pass_a_singular_position_rightly_or_say_so(end, rtol):
    """What follows is not determined by the constraints where a step ends there, and no other branch is taken."""
    case, model = case_of(forty_windows), model_of(forty_windows, "projected")
    options = {"method": "dop853", "rtol": rtol, "atol": rtol / 100, "t_eval": [0.0, end]}
    run = model.simulate((0.0, end), case.initial, case.parameters, **options)
    if run.success:
        assert case.error(run) <= 1e4 * rtol
    else:
        assert run.status is Status.SINGULAR_CONFIGURATION
        assert "constraints lose rank" in run.message


@pytest.mark.parametrize("formulation", ["projected", "baumgarte", "augmented", "ggl"])
def test_equilibrium_and_eigenvalues_of_the_linear_benchmark(formulation):
    entry = published_reference("iftomm_four_bar_with_spring")
    angle, eigenvalues = linear_benchmark(da.compile_model(spring_linkage_scene(), formulation=formulation))
    assert angle == pytest.approx(float(entry["values"]["phi"]), abs=1e-13)
    assert angle == pytest.approx(float(entry["published_equilibrium"]), abs=5e-11)
    expected = complex(*(float(entry["values"][part]) for part in ("real", "imaginary")))
    np.testing.assert_allclose(eigenvalues, [expected.conjugate(), expected], rtol=1e-12)


def test_the_spring_linkage_stays_in_its_equilibrium():
    model = da.compile_model(spring_linkage_scene())
    found = model.trim(
        {"phi": 2.0, "psi": 0.0, "theta": 2.0, "phi_dot": 0.0, "psi_dot": 0.0, "theta_dot": 0.0}, SPRING_LINKAGE
    )
    run = model.simulate((0.0, 5.0), found.initial, SPRING_LINKAGE)
    np.testing.assert_allclose(run.q, run.q[:1].repeat(len(run.q), axis=0), atol=1e-10)


@pytest.mark.parametrize("formulation", ["auto", "projected", "baumgarte", "augmented"])
def test_flexible_slider_crank(formulation):
    """The published start holds the constraints to nine digits, and its end has no more."""
    case = case_of(flexible_crank)
    run = case.simulate(model_of(flexible_crank, formulation))
    assert run.success, run.message
    assert case.error(run) <= case.bound


def test_methods_agree_on_the_flexible_slider_crank_beyond_the_published_digits():
    case, model = case_of(flexible_crank), model_of(flexible_crank, "projected")
    ends = [case.observe(case.simulate(model, method=method, rtol=1e-12)) for method in ("taylor", "dop853")]
    assert np.max(np.abs(ends[0] - ends[1]) / case.sizes(ends[0])) <= 1e-10
