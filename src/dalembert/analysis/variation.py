"""Variational equations of a model: their program, runs of it, and jumps across which they do not hold."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..arrays import FloatArray
from ..codegen import backend_named
from ..codegen.engine import Engine
from ..errors import OptionError, UnknownNameError, list_names, unknown_name
from ..frozen import frozen
from ..ir.conditions import NARROW, Conditions
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..ir.program import Program
from ..once import deriving
from ..reduction.sampling_kernels import SamplingKernels, sampling_kernels
from ..reduction.starting import start_tangents
from ..reduction.variational import input_of, variational
from ..results.analyses import Sensitivity
from ..results.labels import request_hint
from ..runs.engines import segmented
from ..runs.sampling import Sampling
from ..scene.expressions.elapsed import Offset
from ..scene.symbol_table import SymbolTable
from ..starts import inputs
from ..starts.input_values import GivenInputs
from ..starts.segment_constants import starting_constants
from ..steps.dense_output import DenseOutput
from ..steps.problem import IntegrationProblem, Solution, prescribed
from ..stops.breakpoints import break_times
from ..stops.segments import Constants, constants_at
from ..transforms.taylor.nonsmooth import decisions
from ..values import listed

if TYPE_CHECKING:
    from ..pipeline import Stages


# Jumps of rates across which derivatives are not those of the equations of variation: found, and raised as errors.
#
# Where rates jump at a time that what is differentiated by moves, or in a state that it moves, the derivative of the
# motion jumps too. At a time that stays, it does not, and steps end there.

_JUMP = 1e-7
"""Share of the rates that counts as a jump."""
_HALVINGS = 60
_STEPS_AT_ONCE = 4096
"""Steps whose decisions are looked at together: of a million steps they took 22 GB."""


def moved_breaks(program: Program, wrt: tuple[str, ...], c: FloatArray, t0: float, t1: float) -> FloatArray:
    """Return the breaks of a run whose times depend on parameters by which one differentiates."""
    conditions = program.conditions
    if conditions is None:
        return np.zeros(0)
    names = program.layout.parameters
    places = {names.index(name) for name in wrt if name in names}
    moved = [
        kind != NARROW and any(load.array == "p" and load.index in places for load in f.loads)
        for f, kind in zip(conditions.functions, conditions.kinds, strict=True)
    ]
    if not any(moved):
        return np.zeros(0)
    kept = [
        i
        for i, own in enumerate(moved)
        if own
        or (conditions.kinds[i] != NARROW and any(conditions.nested[k] for k in range(i, len(moved)) if moved[k]))
    ]
    some = Conditions(
        conditions.place,
        tuple(conditions.functions[i] for i in kept),
        tuple(conditions.kinds[i] for i in kept),
        tuple(conditions.nested[i] for i in kept),
        tuple(conditions.sharpness[i] for i in kept),
    )
    return break_times(some, c[: len(names)], t0, t1)


def refuse_jumps_at(
    program: Program, times: FloatArray, solution: Solution, c: Constants, size: int, wrt: tuple[str, ...]
) -> None:
    """Reject a run (its first `size` components are the state) whose rates jump at times which it recorded.

    Raises
    ------
    OptionError
        Naming the time.
    """
    order = np.diff(solution.t, append=solution.t[-1:])
    forward = -1.0 if np.any(order < 0.0) else 1.0
    for t in times:
        here = np.flatnonzero(solution.t == t)
        if not len(here):
            continue
        y, near = solution.y[here[:1]], np.array([t, np.nextafter(t, -forward * np.inf)])
        sides = [interpret_rows(program.kernel("rhs"), near[:1], y, constants_at(c, near[i : i + 1])) for i in (0, 1)]
        if _differ(sides[0][0, :size], sides[1][0, :size]):
            raise OptionError(_message(float(t), wrt, "at a time that depends on it"))


def refuse_jumps_between(
    program: Program, kernel: Kernel, solution: Solution, c: Constants, size: int, wrt: tuple[str, ...]
) -> None:
    """Reject a run with continuous output in which decisions change strictly within the span, and rates jump there.

    Raises
    ------
    OptionError
        Naming the time.
    """
    dense = solution.dense
    if dense is None or len(dense.knots) < 2:
        return
    first, last = dense.knots[0], dense.knots[-1]
    for low, high in _changes(kernel, dense, c):
        sides = np.array([low, high])
        if low <= min(first, last) or high >= max(first, last):
            continue
        rates = interpret_rows(program.kernel("rhs"), sides, dense(sides), constants_at(c, sides[:1]))[:, :size]
        if _differ(rates[0], rates[1]):
            raise OptionError(_message(float(high), wrt, "in a state that depends on it"))


def _changes(kernel: Kernel, dense: DenseOutput, c: Constants) -> Iterator[tuple[float, float]]:
    """Yield neighbouring times between which decisions change along a motion, block of steps after block."""
    shares = np.array([0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0])
    for start in range(0, len(dense.knots) - 1, _STEPS_AT_ONCE):
        knots = dense.knots[start : start + _STEPS_AT_ONCE + 1]
        times = np.unique((knots[:-1, np.newaxis] + np.diff(knots)[:, np.newaxis] * shares).ravel())
        made = interpret_rows(kernel, times, dense(times), constants_at(c, times))
        for i in np.flatnonzero(np.any(made[1:] != made[:-1], axis=1)).tolist():
            low, high = float(times[i]), float(times[i + 1])
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                if middle in (low, high):
                    break
                at = np.array([middle])
                if np.any(interpret_rows(kernel, at, dense(at), constants_at(c, at))[0] != made[i]):
                    high = middle
                else:
                    low = middle
            yield low, high


def _differ(a: FloatArray, b: FloatArray) -> bool:
    size = max(float(np.max(np.abs(a), initial=0.0)), float(np.max(np.abs(b), initial=0.0)))
    return bool(np.any(np.abs(a - b) > _JUMP * size))


def _message(t: float, wrt: tuple[str, ...], why: str) -> str:
    return (
        f"sensitivity: the rates of the motion jump at t = {t:.9g}, {why} ({list_names(wrt)}), and derivatives across"
        " such a jump are not those of the equations of variation. End the span before it, smooth the jump (tanh), or"
        " take differences of two runs of simulate; kinks, and jumps at times that do not depend on what is"
        " differentiated by, are fine"
    )


@final
@frozen(eq=False)
class Variation:
    """Equations and names of a run with derivatives.

    Attributes
    ----------
    of, wrt : tuple of str
        Names of values, and of parameters and initial values.
    program : Program
        See `dalembert.reduction.variational`.
    start : Kernel
        Derivatives of the initial state.
    engine : Engine
        The program, loaded.
    """

    of: tuple[str, ...]
    wrt: tuple[str, ...]
    program: Program
    start: Kernel
    engine: Engine

    def _solved(self, problem: IntegrationProblem, method: str, c: Constants) -> Solution:
        """Return the solution of a problem, unless its rates jump where what is differentiated by moves that."""
        if not len(problem.y0):
            return prescribed(problem)
        size = len(problem.y0) // (1 + len(self.wrt))
        moved = moved_breaks(self.program, self.wrt, problem.constants, problem.t0, problem.t1)
        jumping, requested = decisions(self.program), problem.t_eval
        if requested is not None and len(moved):
            forward = 1.0 if problem.t1 >= problem.t0 else -1.0
            requested = forward * np.sort(forward * np.concatenate([requested, moved[~np.isin(moved, requested)]]))
        problem = replace(problem, t_eval=requested, dense=problem.dense or jumping is not None)
        self.engine.prepare(problem, method)
        solution = self.engine.integrate(problem, method)
        refuse_jumps_at(self.program, moved, solution, c, size, self.wrt)
        if jumping is not None:
            refuse_jumps_between(self.program, jumping, solution, c, size, self.wrt)
        return solution

    def run(
        self,
        problem: IntegrationProblem,
        start: FloatArray,
        p: FloatArray,
        method: str,
        weighed: GivenInputs | None = None,
    ) -> Sensitivity:
        """Return values and derivatives along the run of a problem whose y0 (n_y,) is that of `start`.

        `start` are given initial values (n_given,), or the derivatives (n_y, n_wrt) of y0 themselves. `weighed` are the
        inputs, with the weights of those of their values that are differentiated by.
        """
        if weighed is not None:
            layout = self.program.layout
            known = weighed.parameters({}, problem.t0, after=problem.t1 >= problem.t0)
            p = np.concatenate([p, [known[name] for name in layout.parameters[len(p) :]]])
            problem = replace(problem, inputs=weighed.records(layout))
        c = starting_constants(self.program, inputs.constants(self.program, p), problem.t0, problem.t1)
        p = c[: len(p)]
        if start.ndim == 1:
            first = interpret_rows(self.start, np.array([problem.t0]), start.reshape(1, -1), p)[0]
        else:
            first = start.T.ravel()
        varied = replace(problem, y0=np.concatenate([problem.y0, first]), constants=c)
        c = self.engine.constants_along(varied)
        solution = self._solved(varied, method, c)
        if problem.t_eval is not None:
            asked = np.isin(solution.t, problem.t_eval)
            solution = replace(solution, t=solution.t[asked], y=solution.y[asked], wrapped=None)
        out = interpret_rows(self.program.kernel("outputs"), solution.t, solution.y, constants_at(c, solution.t))
        count = len(self.of)
        table = out[:, count:].reshape(len(out), len(self.wrt), count)
        return Sensitivity(
            solution.t,
            self.of,
            self.wrt,
            out[:, :count],
            np.ascontiguousarray(table.transpose(0, 2, 1)),
            solution.status,
            method,
            solution.steps,
            {},
        )


def through_offsets(
    found: Sensitivity, offsets: Sequence[Offset], start: float, parameters: Mapping[str, float]
) -> Sensitivity:
    """Return derivatives by the requested variables; the parameters `offsets`, last in `wrt`, are functions of them."""
    count = len(found.wrt) - len(offsets)
    jacobians = found.jacobians[:, :, :count].copy()
    for place, offset in enumerate(offsets, start=count):
        depends = {symbol.name for symbol in offset.symbols}
        for i, name in enumerate(found.wrt[:count]):
            if name in depends:
                jacobians[:, :, i] += found.jacobians[:, :, place] * offset.derivative(name, start, parameters)
    return replace(found, wrt=found.wrt[:count], jacobians=jacobians)


@deriving
def vary(stages: Stages, given: Sequence[str], of: Sequence[str], wrt: Sequence[str]) -> Variation:
    """Return the variation of a model; its code is generated, loaded and cached as that of the model itself."""
    backend = backend_named(stages.rendered.backend)
    cache = stages.options.cache
    program = variational(stages.reduced, of, wrt)
    kernels = sampling_kernels(stages.reduced, wrt)
    if kernels is not None:
        _refuse_moved(kernels, wrt)
    sampling = None if kernels is None else Sampling.of(program, kernels)
    engine = segmented(backend.load(backend.render(program), cache=cache), program, None, sampling)
    return Variation(tuple(of), tuple(wrt), program, start_tangents(stages.reduced, given, wrt), engine)


def _refuse_moved(kernels: SamplingKernels, wrt: Sequence[str]) -> None:
    moved = [name for name in wrt if name in kernels.moved]
    if moved:
        raise OptionError(
            f"sensitivity: sampling instants of controllers depend on {list_names(moved)}, and derivatives by"
            " parameters that move instants are not those of the equations of variation: take differences of two runs"
        )


def chosen_names(
    program: Program, given: Iterable[str], of: Iterable[Any] | None, wrt: Iterable[Any], symbols: SymbolTable
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of values and of the variables of differentiation, checked.

    Raises
    ------
    UnknownNameError
        For names that are not known, all of them at once.
    OptionError
        Where there is nothing to differentiate.
    """
    layout = program.layout
    known_of = (*layout.variables, *layout.state_rates, *layout.state, *layout.outputs)
    values_of_inputs = [name for name in wrt if input_of(str(name), symbols)] if symbols.inputs else []
    known_wrt = (*layout.given, *given, *map(str, values_of_inputs))

    def resolved(kind: str, names: Iterable[Any], known: Sequence[str]) -> tuple[tuple[str, ...], list[str]]:
        found, wrong = [], []
        for key in listed("wrt" if kind.startswith("parameter") else "of", names, "names or symbols"):
            choices = (str(key), layout.aliases.get(str(key), str(key)))
            name = next((choice for choice in choices if choice in known), None)
            if name is None:
                hint = request_hint(layout, choices[1]) if kind == "output" else ""
                wrong.append(unknown_name(kind, str(key), dict.fromkeys(known)) + hint)
            else:
                found.append(name)
        return tuple(dict.fromkeys(found)), wrong

    values, wrong = resolved("output", layout.variables if of is None else of, known_of)
    sources, unknown = resolved("parameter or given initial value", wrt, known_wrt)
    if wrong or unknown:
        raise UnknownNameError("\n".join([*wrong, *unknown]))
    if not sources or not values:
        raise OptionError(
            "of must name at least one value to differentiate, wrt at least one parameter or given initial value"
        )
    return values, sources
