"""Derivatives of motions: the variational program of a model, made once for each set of names, and runs of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..codegen import backend_named
from ..codegen.base import Engine, FloatArray
from ..errors import OptionError, UnknownNameError, unknown_name
from ..integrators.problem import IntegrationProblem, prescribed
from ..ir.interpret import interpret_rows
from ..ir.program import Kernel, Program
from ..once import deriving
from ..reduction.starting import start_tangents
from ..reduction.variational import variational
from ..results.sensitivity import Sensitivity
from ..scene.elapsed import Offset
from . import inputs

if TYPE_CHECKING:
    from ..compiler import Stages

__all__ = ["Variation", "chosen_names", "through_offsets", "vary"]


@final
@dataclass(frozen=True, eq=False)
class Variation:
    """What it takes to run a model with its derivatives.

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

    def run(self, problem: IntegrationProblem, given: FloatArray, p: FloatArray, method: str) -> Sensitivity:
        """Return values and derivatives along the run of a problem whose y0 (n_y,) starts at `given` (n_given,)."""
        c = inputs.constants(self.program, p)
        first = interpret_rows(self.start, np.array([problem.t0]), given.reshape(1, -1), p)[0]
        varied = replace(problem, y0=np.concatenate([problem.y0, first]), constants=c)
        if len(varied.y0):
            self.engine.prepare(varied, method)
            solution = self.engine.integrate(varied, method)
        else:
            solution = prescribed(varied)
        out = interpret_rows(self.program.kernel("outputs"), solution.t, solution.y, c)
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
    """Return derivatives by what was asked for, of which the parameters `offsets`, last in `wrt`, are functions."""
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
    engine = backend.load(backend.render(program, cache=cache), cache=cache)
    return Variation(tuple(of), tuple(wrt), program, start_tangents(stages.reduced, given, wrt), engine)


def chosen_names(
    program: Program, given: Iterable[str], of: Iterable[Any] | None, wrt: Iterable[Any]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of values and of what they are differentiated with respect to, checked.

    Raises
    ------
    UnknownNameError
        For names that are not known, all of them at once.
    OptionError
        Where there is nothing to differentiate.
    """
    layout = program.layout
    known_of = (*layout.coordinates, *layout.rates, *layout.state, *layout.outputs)
    known_wrt = (*layout.parameters, *given)

    def resolved(kind: str, names: Iterable[Any], known: Sequence[str]) -> tuple[tuple[str, ...], list[str]]:
        found, wrong = [], []
        for key in [names] if isinstance(names, str) else names:
            choices = (str(key), layout.aliases.get(str(key), str(key)))
            name = next((choice for choice in choices if choice in known), None)
            if name is None:
                wrong.append(unknown_name(kind, str(key), dict.fromkeys(known)))
            else:
                found.append(name)
        return tuple(dict.fromkeys(found)), wrong

    values, wrong = resolved("output", (*layout.coordinates, *layout.rates) if of is None else of, known_of)
    sources, unknown = resolved("parameter or given initial value", wrt, known_wrt)
    if wrong or unknown:
        raise UnknownNameError("\n".join([*wrong, *unknown]))
    if not sources or not values:
        raise OptionError(
            "wrt must name parameters or given initial values, of what is to be differentiated: at least one each"
        )
    return values, sources
