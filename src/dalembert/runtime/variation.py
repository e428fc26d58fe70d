"""Variational equations of a model: their program, and runs of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..arrays import FloatArray
from ..codegen import backend_named
from ..codegen.base import Engine
from ..errors import OptionError, UnknownNameError, list_names, unknown_name
from ..integrators.problem import IntegrationProblem, Solution, prescribed
from ..integrators.segments import Constants, constants_at
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..ir.program import Program
from ..once import deriving
from ..reduction.input_weights import input_of
from ..reduction.sampling_kernels import SamplingKernels, sampling_kernels
from ..reduction.starting import start_tangents
from ..reduction.variational import variational
from ..results.sensitivity import Sensitivity
from ..scene.elapsed import Offset
from ..scene.symbol_table import SymbolTable
from ..transforms.nonsmooth import decisions
from ..values import listed
from . import inputs
from .engines import segmented
from .input_values import GivenInputs
from .jumps import moved_breaks, refuse_jumps_at, refuse_jumps_between
from .sampling import Sampling
from .segment_constants import starting_constants

if TYPE_CHECKING:
    from ..pipeline import Stages

__all__ = ["Variation", "chosen_names", "through_offsets", "vary"]


@final
@dataclass(frozen=True, eq=False)
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
                wrong.append(unknown_name(kind, str(key), dict.fromkeys(known)))
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
