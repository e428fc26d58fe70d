"""Square roots that vanish in motions from rest, or relative to a flow, where power series do not exist."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import replace

import numpy as np

from ...arrays import FloatArray
from ...ir.interpret import interpret_rows
from ...ir.kernel import Assignment, Kernel, Operand
from ...ir.program import Program
from .nonsmooth import leading_to

_SAMPLES = 4
_MOST_SPEEDS = 20
"""Speeds of a root, at most, of which those are looked for at which it vanishes."""
_VANISHING, _FINITE = 1e-12, 1e4
"""Share of itself at which a square counts as zero; how much larger than elsewhere rates there count as finite."""


def roots_vanish_at_rest(program: Program) -> bool:
    """Return whether a root is zero, and all rates are finite, at rest, in the zero state, or at rest in a flow.

    At rest all speeds are zero; in a flow, such as wind, they are those at which a quadratic radicand vanishes. Drag in
    proportion to a speed times a velocity is such a force: its rates at rest have one-sided derivatives only. Roots are
    square roots, and powers with exponents that are not whole.
    """
    roots = [line.target for line in program.kernel("rhs").body if line.op == "sqrt" or _is_root(line)]
    if not roots:
        return False
    rhs, layout = program.kernel("rhs"), program.layout
    random = np.random.default_rng(0)
    t, c = random.uniform(0.5, 1.5, _SAMPLES), random.uniform(0.5, 1.5, (_SAMPLES, layout.constants))
    resting = random.uniform(0.5, 1.5, (_SAMPLES, len(layout.state)))
    resting[:, [name not in layout.coordinates for name in layout.state]] = 0.0
    states = np.vstack([resting, np.zeros_like(resting)])
    kernel = replace(rhs, outputs=(*roots, *rhs.outputs))
    values = interpret_rows(kernel, np.tile(t, 2), states, np.tile(c, (2, 1)))
    found = np.all(np.isfinite(values), axis=1) & np.any(values[:, : len(roots)] == 0.0, axis=1)
    if np.any(np.all(found.reshape(2, _SAMPLES), axis=1)):
        return True
    points = [(float(t[i]), random.uniform(0.5, 1.5, len(layout.state)), c[i]) for i in range(2)]
    speeds = frozenset(i for i, name in enumerate(layout.state) if name not in layout.coordinates)
    radicands = [line.args[0] for line in rhs.body if line.op == "sqrt" or _is_root(line)]
    return any(all(_vanishes_in_flow(rhs, value, speeds, *point) for point in points) for value in radicands)


def _vanishes_in_flow(rhs: Kernel, value: Operand, speeds: Set[int], t: float, y: FloatArray, c: FloatArray) -> bool:
    """Whether a radicand, quadratic in the speeds, vanishes at some, near which all rates stay finite.

    Parameters
    ----------
    speeds : set of int
        Components of the state that are speeds.
    t, y, c
        Time, state (n_y,) and constants (n_c,), of which the speeds are varied.
    """
    needed = leading_to(rhs, [value])
    read = {load.index for load in rhs.loads if load.array == "y" and load.target in needed}
    moved = [i for i in sorted(speeds) if i in read]
    count = len(moved)
    if not 0 < count <= _MOST_SPEEDS:
        return False

    def at(changes: FloatArray, outputs: tuple[Operand, ...]) -> FloatArray:
        states = np.tile(y, (len(changes), 1))
        states[:, moved] += changes
        times, constants = np.full(len(changes), t), np.tile(c, (len(changes), 1))
        return interpret_rows(replace(rhs, outputs=outputs), times, states, constants)

    unit, pairs = np.eye(count), np.triu_indices(count, 1)
    steps = np.vstack([np.zeros((1, count)), unit, -unit, unit[pairs[0]] + unit[pairs[1]]])
    values = at(steps, (value,))[:, 0]
    here, ahead, behind = values[0], values[1 : count + 1], values[count + 1 : 2 * count + 1]
    curved = np.diag(ahead + behind - 2.0 * here)
    curved[pairs] = values[2 * count + 1 :] - ahead[pairs[0]] - ahead[pairs[1]] + here
    curved = np.triu(curved) + np.triu(curved, 1).T
    if not (np.all(np.isfinite(values)) and here > 0.0):
        return False
    lowest = np.linalg.lstsq(curved, (behind - ahead) / 2.0, rcond=1e-9)[0]
    found = at(np.array([lowest, 0.0 * lowest]), (value, *rhs.outputs))
    largest = np.max(np.abs(found[:, 1:]), axis=1)
    return bool(abs(found[0, 0]) <= _VANISHING * here and largest[0] <= _FINITE * (1.0 + largest[1]))


def _is_root(line: Assignment) -> bool:
    exponent = line.args[-1]
    return line.op == "pow" and (isinstance(exponent, str) or exponent != round(exponent))
