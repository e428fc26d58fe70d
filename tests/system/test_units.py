"""One scene in other units of length, mass and time: the same starts are accepted, and the motions are the same."""

import functools
import math

import numpy as np
import pytest

import dalembert as da
from dalembert.errors import InitialStateError
from scene.scaled import Units, closed_chain, pendulum, plate, slider_crank

LENGTH, INERTIA, FIELD = (1, 0, 0), (2, 1, 0), (1, 0, -2)
GIVEN = {"m": (0, 1, 0), "g": FIELD, "I_C": INERTIA, "l": LENGTH, "r": LENGTH, "b": LENGTH}
P = {"m": 1.5, "g": 9.81, "I_C": 0.4, "l": 0.7, "r": 0.3}


def _case(build, initial, parameters, lengths, moved):
    """Return a scene with a start in ordinary units, its coordinates that are lengths, and the values to move."""
    dimensions = dict(GIVEN) | dict.fromkeys(lengths, LENGTH)
    for name in initial:
        if name.endswith("_dot"):
            dimensions[name] = (*dimensions.get(name.removesuffix("_dot"), (0, 0, 0))[:2], -1)
    return build, initial, parameters, dimensions, moved


def _crank():
    phi = 0.4
    beta = math.asin(P["r"] * math.sin(phi) / (3 * P["l"]))
    s = P["r"] * math.cos(phi) + 3 * P["l"] * math.cos(beta)
    return {"phi": phi, "beta": beta, "s": s, "phi_dot": 1.3}


def _chain():
    l, middle = P["l"], 1.5 * P["r"]
    x, y = l * math.cos(1.0), -l * math.sin(1.0)
    low = y - math.sqrt(l**2 - (middle - x) ** 2)
    places = {"x_1": x, "y_1": y, "x_2": middle, "y_2": low, "x_3": 2 * middle - x, "y_3": y}
    return places | {"x_1_dot": 0.3, "x_2_dot": -0.1}


CASES = {
    "pendulum": _case(pendulum, {"x": 0.7, "y": 0.0, "x_dot": 0.0, "y_dot": 0.3}, P, ["x", "y"], ["x", "x_dot"]),
    "at the lowest point": _case(pendulum, {"x": 0.0, "y": -0.7, "x_dot": 0.4}, P, ["x", "y"], ["y"]),
    "plate": _case(
        plate,
        {"x": 0.3 / math.tan(0.6), "y": 0.0, "theta": 0.6, "y_dot": 0.0, "theta_dot": 0.5},
        P,
        ["x", "y"],
        ["x", "y", "theta", "y_dot"],
    ),
    "slider-crank": _case(slider_crank, _crank(), P, ["s"], ["phi", "beta", "s"]),
    "closed chain": _case(closed_chain, _chain(), P, list(_chain())[:6], ["y_2"]),
    "sleigh": _case(
        da.scenes.chaplygin_sleigh,
        {"x": 0.0, "y": 0.0, "theta": 0.0, "x_dot": 1.2, "y_dot": 0.0, "theta_dot": 2.0},
        {"m": 1.5, "b": 0.3, "I_C": 0.4},
        ["x", "y"],
        ["y_dot"],
    ),
    "sphere": _case(
        da.scenes.rolling_sphere,
        {"x": 0.0, "y": 0.0, "psi": 0.1, "theta": 0.9, "phi": 0.2, "psi_dot": 0.4, "theta_dot": 0.3, "phi_dot": 1.0},
        {"m": 1.5, "r": 0.3, "g": 9.81},
        ["x", "y"],
        [],
    ),
}
UNITS = [Units(length) for length in (1e-9, 1e-6, 1e-3, 1e3, 1e8)]
UNITS += [Units(1e-6, 1e-15, 1e-3), Units(1e6, 1e9, 1e3), Units(mass=1e-18), Units(time=1e6), Units(time=1e-6)]
ERRORS = (1e-13, 1e-9, 1e-7, 1e-4, 0.3)


@functools.cache
def _model(name, formulation):
    return da.compile_model(CASES[name][0](), backend="numpy", formulation=formulation)


def _outcome(name, formulation, units, moved="", error=0.0):
    """Return the last of a short motion in ordinary units, None where its start is refused."""
    _, initial, parameters, dimensions, _ = CASES[name]
    initial = dict(initial)
    if moved:
        initial[moved] += error
    model = _model(name, formulation)
    start, p = units.of(initial, dimensions), units.of({n: parameters[n] for n in model.layout.given}, dimensions)
    try:
        run = model.simulate(
            (0.0, 0.05 * units.time), start, p, rtol=1e-9, atol=1e-9 * min(units.length, 1.0) / max(units.time, 1.0)
        )
    except InitialStateError:
        return None
    assert run.success, run.message
    ones = dict.fromkeys(initial, 1.0)
    back = units.of(ones, dimensions)
    return {n: (run[n][0] / back[n], run[n][-1] / back[n]) for n in initial}


@pytest.mark.parametrize("formulation", ["auto", "projected"])
@pytest.mark.parametrize("name", CASES)
def test_starts_are_accepted_and_refused_alike_in_all_units(name, formulation):
    changes = [("", 0.0), *((moved, error) for moved in CASES[name][4] for error in ERRORS)]
    ordinary = [_outcome(name, formulation, Units(), *change) for change in changes]
    assert ordinary[0] is not None
    assert not CASES[name][4] or None in ordinary
    for units in UNITS:
        for change, expected in zip(changes, ordinary, strict=True):
            found = _outcome(name, formulation, units, *change)
            assert (found is None) == (expected is None), (units, change)
            for key in expected or ():
                np.testing.assert_allclose(found[key], expected[key], rtol=1e-8, atol=1e-8, err_msg=f"{units} {change}")
