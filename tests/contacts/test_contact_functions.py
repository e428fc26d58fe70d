"""Laws of contact and of impact, dead centres and small linear systems, as plain Python on arrays written by hand."""

import numpy as np
import pytest

from contacts.plain_systems import block, one_case
from dalembert.contacts.contact_impacts import strike
from dalembert.contacts.contact_kinds import refused
from dalembert.contacts.contact_system import CLOSED, OPEN, SLIP, STICK, combination
from dalembert.contacts.selection import mode_candidates as kinds
from dalembert.contacts.selection.contact_forces import load_accelerations, open_contacts, solve_mode
from dalembert.contacts.selection.dense_solve import decompose, dense_workspace, solve_dense
from dalembert.contacts.selection.mode_candidates import candidates_space
from dalembert.contacts.selection.mode_laws import ROUNDING
from dalembert.contacts.selection.mode_selection import select_mode
from dalembert.contacts.selection.slip_direction import turns_back
from dalembert.methods.status import Status

WEIGHT = 10.0


def selected(system, kind, fired=0, along=1.0):
    """Return the status of a selection, and the combination that it takes."""
    pick = candidates_space(system)
    pick.kind[0], pick.fired[0] = kind, fired
    pick.given.mode[0], pick.given.along[0] = SLIP, (along, 0.0)
    load_accelerations(system)
    return select_mode(system, pick, True, False), pick.best


@pytest.mark.parametrize(
    ("push", "mode", "acceleration"),
    [
        (5.9, STICK, 0.0),
        (-5.9, STICK, 0.0),
        (6.0, STICK, 0.0),  # at the limit it still holds
        (6.0 * (1.0 + 10.0 * ROUNDING), SLIP, 2.0),
        (9.0, SLIP, 5.0),
        (-9.0, SLIP, -5.0),
    ],
)
def test_friction_holds_up_to_its_limit_and_then_opposes_the_slip_that_it_lets_begin(push, mode, acceleration):
    system = block(forcing=(push, -WEIGHT), mu=0.4, mu_static=0.6)
    status, best = selected(system, kinds.GRIPPED)
    assert (status, best.mode[0]) == (Status.SUCCESS, mode)
    np.testing.assert_allclose(best.motion, [acceleration, 0.0], rtol=1e-7, atol=1e-12)


@pytest.mark.parametrize("along", [1.0, -1.0])
def test_friction_of_what_slides_opposes_the_velocity_and_not_the_push(along):
    system = block(forcing=(1.0, -WEIGHT), mu=0.4, mu_static=0.6)
    status, best = selected(system, kinds.SLIDING, along=along)
    assert (status, best.mode[0]) == (Status.SUCCESS, SLIP)
    np.testing.assert_allclose(best.motion, [1.0 - along * 4.0, 0.0], rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize(("lift", "mode"), [(9.9, STICK), (10.1, OPEN)])
def test_a_contact_pushes_and_does_not_pull(lift, mode):
    system = block(forcing=(0.0, lift - WEIGHT), mu=0.4, mu_static=0.6)
    status, best = selected(system, kinds.GRIPPED)
    assert (status, best.mode[0]) == (Status.SUCCESS, mode)
    np.testing.assert_allclose(best.motion, [0.0, max(lift - WEIGHT, 0.0)], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("fired", "direction"), [(kinds.BREAK_UP, 1.0), (kinds.BREAK_DOWN, -1.0)])
def test_what_friction_has_just_failed_to_hold_slips_to_the_side_of_the_guard(fired, direction):
    system = block(forcing=(direction * 6.0, -WEIGHT), mu=0.4, mu_static=0.6)
    status, best = selected(system, kinds.GRIPPED, fired)
    assert (status, best.mode[0], best.along[0, 0]) == (Status.SUCCESS, SLIP, direction)


@pytest.mark.parametrize(
    ("lift", "status"), [(-1.0, Status.CONTACT_IMPOSSIBLE), (1.0, Status.CONTACT_AMBIGUOUS), (0.0, Status.SUCCESS)]
)
def test_paradox_of_painleve(lift, status):
    """A unit of the normal reaction, with friction, pulls the gap shut: its acceleration is lift - N.

    With lift < 0 neither an open contact nor a closed one obeys the laws; with lift > 0 both do.
    """
    system = block(mass=np.linalg.inv([[5.0, 2.0], [2.0, 1.0]]), rates=(1.0, 0.0), mu=1.0, mu_static=1.0)
    system.forcing[:] = system.mass @ [0.0, lift]
    assert selected(system, kinds.SLIDING)[0] == status


def after_impact(rates, *, slides=True, **numbers):
    """Return status and rates of a case that is struck."""
    system = block(rates=rates, **numbers)
    pick, cases = candidates_space(system), one_case(system)
    pick.kind[0], pick.struck[0] = kinds.SLIDING if slides else kinds.GRIPPED, 1
    pick.given.mode[0], pick.given.along[0] = OPEN, (np.sign(rates[0]), 0.0)
    cases.approach[0, 0], cases.speeds[0, 0] = -rates[1], abs(rates[0])
    return strike(system, pick, cases, 0), cases.x[0, 2:], cases.after[0, 0]


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("slip", [5.0, -5.0, 0.3, -0.3])
def test_impacts_give_back_a_share_of_the_approach_and_friction_no_more_than_its_impulse(restitution, slip):
    """The law of Newton with friction of Coulomb: an impulse of (1 + e) m v, and mu of it against the slip."""
    mu, speed = 0.4, 2.0
    status, rates, after = after_impact((slip, -speed), mu=mu, mu_static=mu, restitution=restitution)
    impulse = mu * (1.0 + restitution) * speed
    left = np.sign(slip) * max(abs(slip) - impulse, 0.0)
    assert status == Status.SUCCESS
    np.testing.assert_allclose(rates, [left, restitution * speed], rtol=1e-13, atol=1e-14)
    assert after == (kinds.FREE if restitution > 0.0 else kinds.SLIDING if left else kinds.GRIPPED)


def test_what_slides_into_an_impact_sticks_within_mu_and_not_within_the_friction_of_rest():
    slip, speed = 1.0, 2.0  # 0.4 * 2 < 1 <= 0.6 * 2
    _, sliding, _ = after_impact((slip, -speed), mu=0.4, mu_static=0.6)
    assert sliding[0] == pytest.approx(slip - 0.4 * speed, rel=1e-13)


def test_impacts_without_end_at_one_instant_accumulate():
    system = block(rates=(0.0, -1.0), restitution=0.5)
    pick, cases = candidates_space(system), one_case(system)
    pick.kind[0], pick.struck[0], cases.impacts[0] = kinds.GRIPPED, 1, 9_999
    assert strike(system, pick, cases, 0) == Status.SUCCESS
    assert strike(system, pick, cases, 0) == Status.EVENTS_ACCUMULATE


@pytest.mark.parametrize(
    ("numbers", "bad"),
    [
        ({"mu": 0.3, "mu_static": 0.3, "restitution": 1.0}, False),
        ({"mu": -0.1, "mu_static": 0.3}, True),
        ({"mu": 0.3, "mu_static": 0.2}, True),
        ({"restitution": -0.1}, True),
        ({"restitution": 1.1}, True),
        ({"gap": -0.1}, True),
        ({"gap": 0.1}, False),
    ],
)
def test_coefficients_without_a_sense_and_penetration_are_refused(numbers, bad):
    system = block(**numbers)
    assert refused(system, one_case(system), 0) == bad


@pytest.mark.parametrize(("gap", "x", "bad"), [(-1e-8, 2.0, False), (-3e-8, 2.0, True), (-1e-8, 1e-3, True)])
def test_penetration_within_a_share_of_the_position_starts(gap, x, bad):
    system = block(gap=gap)
    assert refused(system, one_case(system, x), 0) == bad


@pytest.mark.parametrize(
    ("entry", "depends", "back"),
    [(0.0, (1, 0), True), (0.0, (0, 1), False), (1.0, (1, 0), False)],
    ids=["it will move", "what it depends on is held", "it moves now"],
)
def test_a_dead_centre_is_where_slip_does_not_depend_on_rates_that_the_mode_leaves_free(entry, depends, back):
    system, chosen = block(mu=0.5, mu_static=0.5), combination(1, 2)
    system.jacobian[1], system.slides_by[0], chosen.mode[0] = (entry, 0.0), depends, STICK
    system.power[1] = entry, 0.0
    load_accelerations(system)
    solve_mode(system, chosen)
    assert turns_back(system, chosen, 0) == back


def test_modes_are_solved_as_the_equations_of_newton_say():
    """Closed without a law of sliding, slipping, sticking, and open, at an incline's forces."""
    system, chosen = block(forcing=(3.0, -WEIGHT), mu=0.2, mu_static=0.2), combination(1, 2)
    load_accelerations(system)
    found = {}
    for mode in (CLOSED, SLIP, STICK, OPEN):
        chosen.mode[0], chosen.along[0] = mode, (1.0, 0.0)
        solve_mode(system, chosen)
        found[mode] = [*system.motion, system.press[0], system.forces[0, 0] if mode != OPEN else 0.0]
        assert open_contacts(chosen) == (1 if mode == OPEN else 0)
    expected = {CLOSED: (3, 0, 10, 0), SLIP: (1, 0, 10, -2), STICK: (0, 0, 10, -3), OPEN: (3, -10, 0, 0)}
    for mode, values in expected.items():
        np.testing.assert_allclose(found[mode], values, rtol=1e-13, atol=1e-13, err_msg=str(mode))


def test_dense_systems_are_solved_as_numpy_solves_them():
    rng, space = np.random.default_rng(3), dense_workspace(5)
    matrix, right = rng.normal(size=(5, 5)) * 10.0 ** rng.integers(-6, 7, 5)[:, np.newaxis], rng.normal(size=(5, 2))
    expected = np.linalg.solve(matrix, right)
    assert solve_dense(matrix.copy(), right, 5, 2, space) == 0
    np.testing.assert_allclose(right, expected, rtol=1e-9)


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_singular_systems_have_the_solution_of_least_norm_and_their_free_directions(rank):
    rng, space, n = np.random.default_rng(rank), dense_workspace(4), 4
    matrix = rng.normal(size=(n, rank)) @ rng.normal(size=(rank, n))
    right = (matrix @ rng.normal(size=n))[:, np.newaxis]
    least = np.linalg.lstsq(matrix, right, rcond=1e-10)[0]
    assert solve_dense(matrix.copy(), right, n, 1, space) == n - rank
    np.testing.assert_allclose(right, least, rtol=1e-9, atol=1e-9)
    free = space.free[: n - rank]
    np.testing.assert_allclose(matrix @ free.T, 0.0, atol=1e-9)
    np.testing.assert_allclose(free @ free.T, np.eye(n - rank), atol=1e-9)


@pytest.mark.parametrize("seed", [6, 18, 34, 60])
def test_columns_of_rounding_errors_are_not_turned_again_and_again(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 9))
    rank = int(rng.integers(1, n))
    rows, space = rng.integers(-3, 4, size=(n, rank)).astype(float), dense_workspace(n)
    matrix = rows @ np.diag(10.0 ** rng.integers(-3, 4, rank)) @ rows.T
    assert decompose(matrix, n, space) < 10
    exact = np.linalg.svd(matrix, compute_uv=False)
    np.testing.assert_allclose(np.sort(space.columns)[::-1], exact, rtol=1e-9, atol=1e-14 * exact[0])


def test_systems_of_what_is_not_finite_have_no_solution():
    right = np.ones((2, 1))
    assert solve_dense(np.array([[1.0, np.nan], [0.0, 1.0]]), right, 2, 1, dense_workspace(2)) == 0
    assert np.isnan(right).all()
