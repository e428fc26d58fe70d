"""Consistent states: closed loops assembled from a rough guess, and the state nearest to one that is not consistent.

Positions are found by the method of Levenberg and Marquardt (J. J. More, Lecture Notes in Mathematics 630, 1978,
with the damping of H. B. Nielsen), which ends at a least residual even where loops cannot close, and then drawn to
the guess along the constraints; rates solve the velocity constraints by least squares. Ranks are decided by singular
values, so that redundant constraints do no harm. All of it is done with coordinates and rates as shares of their sizes,
and with constraints as shares of theirs, so that no result depends on units.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..arrays import FloatArray
from ..errors import InitialStateError, list_names
from ..frozen import frozen
from ..ir.interpret import interpret_rows
from ..ir.program import Program
from .constraint_rows import row_lengths
from .inputs import constants
from .segment_constants import at_time
from .state_sizes import distance_sizes, least_speed

if TYPE_CHECKING:
    from ..model.model import CompiledModel

_ITERATIONS = 300
_DRAWS = 60
_RANK = 1e-9
_CLOSED, _LEAST = 1e-10, 1e-4
"""Residual that counts as closed beside the terms of its constraint, and their least size beside the constraint's."""


@final
@frozen
class _Constraints:
    """The constraints of a program at given constants and time, in shares of sizes.

    Attributes
    ----------
    sizes : ndarray (n_q,)
        Of coordinates, and of rates in a unit of time.
    lengths : ndarray (n_constraints,)
        Of constraints: what they change by where a coordinate changes by its size.
    """

    program: Program
    c: FloatArray
    t: float
    states: FloatArray
    sizes: FloatArray
    lengths: FloatArray

    @classmethod
    def near(cls, program: Program, c: FloatArray, t: float, x: FloatArray) -> _Constraints:
        """Return the constraints with sizes from coordinates, rates and first-order states x (n,)."""
        count = len(program.layout.constraints)
        lengths = np.ones(count)
        if count:
            lengths = row_lengths(program, np.array([t]), x[np.newaxis], c, range(count))[0]
        states = x[2 * len(program.layout.coordinates) :]
        return cls(program, c, t, states, distance_sizes(program, t, x, c), lengths)

    def _run(self, kernel: str, q: FloatArray, qdot: FloatArray | None = None) -> FloatArray:
        if kernel not in self.program:
            return np.zeros(0)
        rates = np.zeros_like(q) if qdot is None else qdot
        x = np.concatenate([self.sizes * q, self.sizes * rates, self.states])[np.newaxis]
        with np.errstate(all="ignore"):
            return interpret_rows(self.program.kernel(kernel), np.array([self.t]), x, self.c)[0]

    def positions(self, q: FloatArray) -> FloatArray:
        """Return the residuals of the holonomic constraints."""
        found = self._run("position_residual", q)
        return found / self.lengths[: len(found)]

    def rates(self, q: FloatArray, qdot: FloatArray) -> FloatArray:
        """Return the residuals of all velocity constraints."""
        found = self._run("velocity_residual", q, qdot)
        return found / self.lengths[: len(found)]

    def jacobian(self, q: FloatArray, *, holonomic: bool) -> FloatArray:
        """Return the Jacobian of the velocity constraints, or of the holonomic ones."""
        layout = self.program.layout
        matrix = self._run("constraint_jacobian", q).reshape(len(layout.constraints), len(q))
        matrix = matrix * self.sizes / self.lengths[:, np.newaxis]
        return matrix[: layout.holonomic] if holonomic else matrix

    def left(self, residual: FloatArray, limits: FloatArray) -> str:
        """Return which constraints have residuals above the limits, a line each, or nothing."""
        rows = zip(self.program.layout.constraints, residual, limits, self.lengths, strict=False)
        open_ = [
            f"{label}: {value * length:.3g} is left" for label, value, limit, length in rows if not abs(value) <= limit
        ]
        return "\n  ".join(open_)


def assembled_by(
    model: CompiledModel, t: float, guess: Mapping[str, float], parameters: Mapping[Any, Any], fixed: Collection[str]
) -> dict[str, float]:
    """Return consistent initial values of a model of one mode near a guess."""
    program = model.stages.program
    c = constants(program, model.parameter_vector(parameters))
    return assembled(program, at_time(program, c, t), t, guess, fixed)


def assembled(
    program: Program, c: FloatArray, t: float, guess: Mapping[str, float], fixed: Collection[str]
) -> dict[str, float]:
    """Return consistent coordinates near a guess, and rates where the guess gives any.

    Parameters
    ----------
    program : Program
        With the kernels of the constraints.
    c : ndarray (n_c,)
        Constants.
    t : float
        Time.
    guess : mapping of str to float
        Every coordinate; of the rates, those that the constraints fix may be missing. First-order states stay as they
        are given; they may be missing where no constraint depends on them.
    fixed : collection of str
        Names that keep the value of the guess.

    Raises
    ------
    InitialStateError
        When a coordinate or a state is missing, loops cannot close, or the rates cannot be reconciled or are not
        determined.
    """
    layout = program.layout
    missing = [name for name in layout.coordinates if name not in guess]
    if missing:
        raise InitialStateError(
            f"a guess is missing for the coordinates {list_names(missing)}; any rough value will do"
        )
    start = np.array([guess[name] for name in layout.coordinates])
    rates = np.array([guess.get(name, 0.0) for name in layout.rates])
    constraints = _Constraints.near(program, c, t, np.concatenate([start, rates, _states(program, guess)]))
    movable, sizes = np.array([name not in fixed for name in layout.coordinates]), constraints.sizes
    q = _closed(constraints, start / sizes, movable)
    found = dict(zip(layout.coordinates, np.where(movable, sizes * q, start).tolist(), strict=True))
    if any(name in guess for name in layout.rates):
        kept = np.array([name in guess and name in fixed for name in layout.rates])
        qdot = _moving(constraints, q, rates / sizes, guess, fixed)
        found |= dict(zip(layout.rates, np.where(kept, rates, sizes * qdot).tolist(), strict=True))
    return found | {name: guess[name] for name in layout.states if name in guess}


def _states(program: Program, guess: Mapping[str, float]) -> FloatArray:
    """Return first-order states (n_z,), zero where one is missing on which no constraint depends."""
    layout, first = program.layout, 2 * len(program.layout.coordinates)
    missing = [i for i, name in enumerate(layout.states) if name not in guess]
    kernels = [program.kernel(name) for name in ("velocity_residual", "constraint_jacobian") if name in program]
    used = {load.index for kernel in kernels for load in kernel.loads if load.array == "y"}
    lost = [layout.states[i] for i in missing if first + i in used]
    if lost and any(name in guess for name in layout.rates):
        raise InitialStateError(
            f"a guess is missing for the states {list_names(lost)}, on which velocity constraints depend"
        )
    return np.array([guess.get(name, 0.0) for name in layout.states])


def nearest(program: Program, c: FloatArray, t: float, values: Mapping[str, float]) -> str:
    """Return a sentence on the consistent state nearest to given values, or nothing where none was found."""
    values = {name: value for name, value in values.items() if name not in program.layout.entries}
    try:
        found = assembled(program, c, t, values, ())
    except InitialStateError:
        return ""
    changes = {name: found[name] - value for name, value in values.items()}
    distance = float(np.linalg.norm(list(changes.values())))
    shown = sorted(changes, key=lambda name: -abs(changes[name]))[:6]
    moved = ", ".join(f"{name} = {found[name]:.10g}" for name in shown if abs(changes[name]) > 1e-3 * distance)
    return (
        f"\nThe nearest consistent state is at distance {distance:.3g}, mainly by {moved};"
        " model.assemble(initial, parameters) returns it"
    )


def _closed(constraints: _Constraints, start: FloatArray, movable: np.ndarray[Any, Any]) -> FloatArray:
    """Return the closed position near `start`."""
    if not constraints.program.layout.holonomic:
        return start
    q = _least_residual(constraints, start, movable)
    if not _within(constraints, q):
        raise InitialStateError(_open(constraints, q, movable))
    q = _drawn(constraints, q, start, movable)
    for _ in range(3):
        q = _newton(constraints, q, movable)
    return q


def _newton(constraints: _Constraints, q: FloatArray, movable: np.ndarray[Any, Any]) -> FloatArray:
    moved = q.copy()
    jacobian = constraints.jacobian(q, holonomic=True)[:, movable]
    moved[movable] -= np.linalg.pinv(jacobian, rcond=_RANK) @ constraints.positions(q)
    better = np.linalg.norm(constraints.positions(moved)) <= np.linalg.norm(constraints.positions(q))
    return moved if better else q


def _inverse(matrix: FloatArray, size: float) -> FloatArray:
    """Return the pseudo-inverse; singular values small beside `size` are none."""
    u, s, vt = np.linalg.svd(matrix, full_matrices=False)
    kept = s > _RANK * size
    inverse: FloatArray = (vt[kept].T / s[kept]) @ u[:, kept].T
    return inverse


def _least_residual(constraints: _Constraints, start: FloatArray, movable: np.ndarray[Any, Any]) -> FloatArray:
    """Minimize the sum of the squares of the residuals, from `start`."""
    q = start.copy()
    residual = constraints.positions(q)
    if not np.all(np.isfinite(residual)):
        raise InitialStateError("the constraints are not finite at the guess; start from other values")
    damping, growth = -1.0, 2.0
    for _ in range(_ITERATIONS):
        jacobian = constraints.jacobian(q, holonomic=True)[:, movable]
        u, s, vt = np.linalg.svd(jacobian, full_matrices=False)
        if damping < 0.0:
            damping = 1e-3 * float(np.max(s, initial=0.0)) ** 2
        down = u.T @ residual
        step = -vt.T @ (s / (s * s + damping + 1e-300) * down)
        if not np.any(np.abs(step) > 1e-15 * (1e-3 + np.abs(q[movable]))):
            break
        trial = q.copy()
        trial[movable] += step
        new = constraints.positions(trial)
        gain = residual @ residual - new @ new
        expected = float(step @ (damping * step - jacobian.T @ residual))
        if np.all(np.isfinite(new)) and gain > 0.0:
            q, residual = trial, new
            ratio = float(gain) / max(expected, 1e-300)
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3)
            growth = 2.0
        else:
            damping *= growth
            growth *= 2.0
            if not np.isfinite(damping) or damping > 1e30:
                break
    return q


def _drawn(constraints: _Constraints, q: FloatArray, start: FloatArray, movable: np.ndarray[Any, Any]) -> FloatArray:
    """Draw a closed position towards `start`: iterations for the nearest one, kept while they come nearer."""
    best, distance = q, float(np.linalg.norm(q - start))
    for _ in range(_DRAWS):
        jacobian = constraints.jacobian(best, holonomic=True)[:, movable]
        back = (start - best)[movable]
        moved = start.copy()
        moved[movable] -= np.linalg.pinv(jacobian, rcond=_RANK) @ (constraints.positions(best) + jacobian @ back)
        for _ in range(4):
            moved = _newton(constraints, moved, movable)
        nearer = float(np.linalg.norm(moved - start))
        if not (_within(constraints, moved) and nearer < distance * (1.0 - 1e-12)):
            break
        best, distance = moved, nearer
    return best


def _limits(matrix: FloatArray, x: FloatArray, least: float | FloatArray = _LEAST) -> FloatArray:
    limits: FloatArray = _CLOSED * (least + np.abs(matrix) @ np.abs(x))
    return limits


def _within(constraints: _Constraints, q: FloatArray) -> bool:
    limits = _limits(constraints.jacobian(q, holonomic=True), q)
    return bool(np.all(np.abs(constraints.positions(q)) <= limits))


def _open(constraints: _Constraints, q: FloatArray, movable: np.ndarray[Any, Any]) -> str:
    """Return why loops do not close: the residual of each constraint at the best position found."""
    layout = constraints.program.layout
    left = constraints.left(constraints.positions(q), _limits(constraints.jacobian(q, holonomic=True), q))
    held = [name for name, free in zip(layout.coordinates, movable, strict=True) if not free]
    at = ", ".join(
        f"{name} = {value:.4g}" for name, value in zip(layout.coordinates, constraints.sizes * q, strict=True)
    )
    kept = f", with {list_names(held)} fixed" if held else ""
    return (
        f"scene {constraints.program.name!r} cannot be assembled from this guess{kept}. The least residual found is at"
        f" {at}, where\n  {left}\nCheck lengths and fixed values: the loops may be unable to close."
        " If they can, start from a guess nearer to a closed position"
    )


def _moving(
    constraints: _Constraints, q: FloatArray, given: FloatArray, guess: Mapping[str, float], fixed: Collection[str]
) -> FloatArray:
    """Return rates that satisfy the velocity constraints, near the given ones; missing ones follow from them."""
    names, qdot = constraints.program.layout.rates, given.copy()
    missing = np.array([name not in guess for name in names])
    free = np.array([name in guess and name not in fixed for name in names])
    jacobian = constraints.jacobian(q, holonomic=False)
    unknown = jacobian[:, missing]
    size = max(float(np.linalg.norm(jacobian)), 1e-300)
    if np.any(missing) and np.linalg.matrix_rank(unknown, tol=_RANK * size) < unknown.shape[1]:
        lost = [name for name, gone in zip(names, missing, strict=True) if gone]
        raise InitialStateError(
            f"a guess is missing for the rates {list_names(lost)}: the constraints do not fix all of them, and"
            " nothing defaults to zero"
        )
    inverse = _inverse(unknown, size)
    across = jacobian[:, free] - unknown @ (inverse @ jacobian[:, free])
    back = _inverse(across, size)
    for _ in range(2):
        qdot[missing] -= inverse @ constraints.rates(q, qdot)
        qdot[free] -= back @ constraints.rates(q, qdot)
        qdot[missing] -= inverse @ constraints.rates(q, qdot)
    drift = np.abs(constraints.rates(q, np.zeros_like(qdot)))
    least = least_speed(constraints.sizes * qdot, constraints.sizes)
    left = constraints.left(constraints.rates(q, qdot), _limits(jacobian, qdot, drift + least))
    if left:
        raise InitialStateError(
            f"no rates near the guess satisfy the velocity constraints:\n  {left}\nFix fewer of them"
        )
    return qdot
