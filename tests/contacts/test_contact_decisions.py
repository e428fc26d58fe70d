"""Mode selection against the laws of contact and the equations of the selected mode, which come from the graph."""

import numpy as np
import pytest
import sympy as sp

import dalembert as da
from dalembert.contacts.contact_cases import contact_cases
from dalembert.contacts.equations.contact_laws import STATES
from dalembert.contacts.selection import mode_candidates as rules
from dalembert.methods.status import Status
from hard_cases.contacts import corner_plate, loose_plate

MU = sp.Symbol("mu", positive=True)
CASES = 200
VALUES = {"m": 1.0, "l": 1.0, "h": 0.5, "g": 9.81}
SCENES = {
    "starts": (lambda: corner_plate(7), None, {}),
    "stops": (lambda: corner_plate(7), ("slip",), {0: rules.STOP}),
    "breaks": (lambda: corner_plate(7), ("stick",), {0: rules.BREAK_UP}),
    "turns": (lambda: corner_plate(7), ("slip",), {0: rules.TURN}),
    "lifts": (lambda: corner_plate(7, contact=True), ("slip",), {0: rules.LIFT}),
    "one of two lifts": (lambda: loose_plate(3, corner=MU), ("closed", "slip"), {0: rules.LIFT}),
    "one of two stops": (lambda: loose_plate(3, corner=MU), ("closed", "slip"), {1: rules.STOP}),
}


def _cases(model, moving):
    """Return random states (k, 2 n_q) in which the contacts touch, and parameters (k, n_p)."""
    rng, layout = np.random.default_rng(7), model.layout
    theta, rate = rng.uniform(0.3, 1.2, CASES), rng.normal(size=CASES) * moving
    given = {"x": -0.5 / np.tan(theta), "y": 0 * theta, "theta": theta, "theta_dot": rate, "y_dot": 0 * theta}
    given["x_dot"] = 0.5 * rate / np.sin(theta) ** 2
    x = np.column_stack([given[name] for name in (*layout.coordinates, *layout.rates)])
    values = VALUES | {"mu": rng.uniform(0.1, 1.0, CASES)}
    return x, np.column_stack([np.broadcast_to(values[name], CASES) for name in layout.parameters])


@pytest.mark.parametrize("name", SCENES)
def test_the_selected_mode_has_the_motion_of_its_own_equations_and_breaks_no_law(name):
    scene, mode, fired = SCENES[name]
    model = da.compile_model(scene())
    x, p = _cases(model, moving=0.0 if {rules.STOP, rules.BREAK_UP} & set(fired.values()) else 1.0)
    cases = contact_cases(np.zeros(CASES), x, p, np.ones(CASES), len(model.contacts))
    if mode is not None:
        cases.modes[:] = [STATES.index(state) for state in mode]
    for contact, flag in fired.items():
        cases.fired[:, contact] = flag
    model.modes.decisions.decide(cases)
    good = np.flatnonzero(cases.status == Status.SUCCESS)
    assert len(good) > CASES / 10  # not every state is one in which this can happen
    for i in good[:40]:
        selected = model.modes.automaton.mode(int(cases.number[i]))
        assert [STATES.index(state) for state in selected] == cases.modes[i].tolist()
        own = model.modes.model(selected)
        added = model.modes.added(selected, cases.added[i])
        values = dict(zip(model.layout.parameters, p[i].tolist(), strict=True))
        values |= {key: float(value) for key, value in added.items()}
        n = len(model.layout.coordinates)
        q, qdot = cases.x[i, :n], cases.x[i, n:]
        acceleration = own.accelerations(0.0, q, qdot, values)
        np.testing.assert_allclose(cases.motion[i], acceleration, rtol=1e-9, atol=1e-9)
        states = dict(zip((*model.layout.coordinates, *model.layout.rates), cases.x[i].tolist(), strict=True))
        run = own.simulate((0.0, 0.0), states, values)
        for guard in model.modes.guards(selected) if rules.TURN not in fired.values() else ():
            assert run[guard.output][0] > -1e-6, (guard, selected)


def test_senseless_coefficients_and_penetration_are_initial_states_refused():
    model = da.compile_model(corner_plate(7, contact=True))
    x, p = _cases(model, moving=1.0)
    p[5, model.layout.parameters.index("mu")] = -0.1
    x[6, model.layout.coordinates.index("x")] -= 0.3
    cases = contact_cases(np.zeros(CASES), x, p, np.ones(CASES), 1)
    model.modes.decisions.decide(cases)
    assert cases.status[5] == Status.INITIAL_STATE
    assert cases.status[0] == Status.SUCCESS


def test_decisions_as_plain_python_are_those_of_machine_code(monkeypatch):
    from dalembert.codegen.llvm.loops import DEBUG_VARIABLE, debugging, loop_named

    model = da.compile_model(loose_plate(3, corner=MU))
    x, p = _cases(model, moving=1.0)
    found = []
    for debug in ("0", "1"):
        monkeypatch.setenv(DEBUG_VARIABLE, debug)
        debugging.cache_clear()
        loop_named.cache_clear()
        cases = contact_cases(np.zeros(20), x[:20], p[:20], np.ones(20), 2)
        model.modes.decisions.decide(cases)
        found.append(cases)
    debugging.cache_clear()
    loop_named.cache_clear()
    for compiled, plain in zip(*found, strict=True):
        np.testing.assert_array_equal(compiled, plain)


def test_linearisation_is_that_of_the_mode_at_hand():
    """A block on a spring: free where it slides, held where it sticks; a ball that rests has no motion left."""
    from hard_cases.contacts import table_oscillator

    model = da.compile_model(table_oscillator())
    values = {"m": 1.0, "k": 4.0, "mu": 0.5, "g": 10.0}
    values = {name: values[name] for name in model.layout.parameters if name in values}
    sliding = model.linearize(0.0, {"x": 0.1, "x_dot": 0.3}, values)
    np.testing.assert_allclose(sorted(sliding.eigenvalues.imag), [-2.0, 2.0], rtol=1e-12)
    direct = model.mode().linearize(
        0.0, {"x": 0.1, "x_dot": 0.3}, values | {n: 1.0 for n in model.mode().layout.parameters if n not in values}
    )
    np.testing.assert_array_equal(sliding.A, direct.A)
    sticking = model.linearize(0.0, {"x": 0.1, "x_dot": 0.0}, values)
    assert sticking.A.size == 0 or not np.any(sticking.A)


def test_states_have_one_number_in_the_equations_and_in_compiled_code():
    from dalembert.contacts import contact_system

    assert [getattr(contact_system, state.upper()) for state in STATES] == list(range(len(STATES)))


def test_guards_have_the_same_bits_in_the_automaton_and_in_compiled_code():
    from dalembert.contacts.automaton import BITS, TRANSITIONS

    breaks = {"BREAK_UP": ("break", 1), "BREAK_DOWN": ("break", -1), "BREAK_PLANE": ("break", 0)}
    named = {kind.upper(): (kind, 0) for kind in TRANSITIONS if kind not in ("break", "paradox", "kink")} | breaks
    assert {guard: getattr(rules, name) for name, guard in named.items()} == BITS
    assert sorted(BITS.values()) == [1 << bit for bit in range(len(BITS))]
