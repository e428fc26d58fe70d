"""Method of models that makes functions for programs in JAX: `solve_fn`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ..codegen import backend_named
from ..codegen.base import Capability
from ..errors import CapabilityError, OptionError, list_names
from ..ir.program import DIRECTION
from ..options import NamedTolerances, SolveOptions
from ..runs.capabilities import refuse_sampling
from ..runs.component_tolerances import with_names
from ..starts import inputs as run_input

if TYPE_CHECKING:
    from ..codegen.engine import TracedEngine
    from ..codegen.runs import HostedRuns
    from .model import CompiledModel


def solve_fn(
    self: CompiledModel,
    given: Iterable[str] | None = None,
    *,
    method: str = "auto",
    rtol: float | None = None,
    atol: float | Mapping[str, float] | None = None,
    max_step: float = np.inf,
    max_steps: int = 4096,
    dense: bool = False,
    throw: bool = False,
    portable: bool = False,
    events: Any = (),
    reduce: Any = None,
) -> Any:
    """Return a pure function ``solve(t, initial, p)`` that JAX can trace, vectorise and differentiate.

    With contacts that change, its runs are left to the compiled backend on the host, one call for a whole batch, and
    have no derivatives; the state is that of coordinates and rates.

    Parameters
    ----------
    given : iterable of str, optional
        Names of the coordinates and rates that `initial` holds; the others follow from the constraints, as in
        `simulate`. Without it, `initial` is the state y (n_y,).
    method : str
        As for `simulate`.
    rtol : float, optional
    atol : float or mapping of symbols or names to float, optional
        As for `simulate`; by default 1e-8 and 1e-10, in a process of single precision 1e-5 and 1e-7.
    max_step : float
        Largest step size [s]. Steps are chosen for the motion, and derivatives are those of these steps: where the
        motion is simpler than its neighbours (a sleigh that slides straight on), bound the step to resolve them.
    max_steps : int
        Attempted steps after which the run ends with a status.
    dense : bool
        Whether the result has a motion ``dense(t)`` at any time, traced ones among them. It keeps a record of
        `max_steps` steps; with events, reductions or contacts, every call of it is a run of its own.
    throw : bool
        Whether a run that fails raises `RunFailedError`. Inside ``jax.jit``, ``jax.grad`` and ``jax.vmap`` it is
        raised on the host while the program runs, so that JAX raises an error of its own with that text.
    portable : bool
        Whether programs with such runs may be exported (``jax.export``). Else single runs and batches on CPUs are calls
        of machine code of this process, which are faster, and which ``jax.export`` does not support.
    events, reduce
        As for `sweep`: ``solved.events``, ``solved.reduced`` and ``solved.end`` hold what they give. Symbols that only
        events and reductions contain are further parameters of the function. Such runs, and those of scenes whose
        contacts change, are left to the compiled backend on the host; see the page on the jax backend.

    Returns
    -------
    Solve
        Its docstring describes arguments and result.

    Raises
    ------
    CapabilityError
        For a backend other than "jax".
    OptionError
        For options that do not exist.
    UnknownNameError, InitialStateError
        For names that are not known or not enough.
    """
    if Capability.SOLVE_FUNCTION not in backend_named(self.backend).capabilities:
        raise CapabilityError(Capability.SOLVE_FUNCTION.value)
    watching = self.modes is not None or reduce is not None or not (isinstance(events, tuple) and not events)
    if watching:
        if portable:
            changing = f"contacts that change ({list_names(self.contacts)})" if self.modes is not None else ""
            raise OptionError(
                f"runs with {changing or 'events or reductions'} are calls of the host, which jax.export does not"
                " support: take portable=True"
                f" {'in one mode, as mode() gives it' if changing else 'without events= and reduce='}"
            )
        from ..runs.hosted import hosted_runs, with_symbols  # for these runs alone

        self = with_symbols(self, events, reduce)
    if given is not None:
        names = [self.layout.aliases.get(str(name), str(name)) for name in given]
        given = tuple(run_input.given_values(self.layout, dict.fromkeys(names, 0.0)))
    options = SolveOptions(
        method=method,
        rtol=rtol,
        atol=cast("float | None", atol),
        max_step=max_step,
        max_steps=max_steps,
        dense=dense,
        throw=throw,
        portable=portable,
    )
    if isinstance(options.atol, NamedTolerances):
        options = replace(options, atol=with_names(self, options.atol))
    if self.modes is not None:
        hosted = hosted_runs(self, given, method, options, events, reduce)
        return cast("TracedEngine", self.modes.engine()).hosted_solve_fn(None, options, cast("HostedRuns", hosted))
    if self.stages.reduced.equations.kinked_locks:
        raise CapabilityError(
            "solve_fn does not see the attitudes at which angles lock, where positions of this scene have a kink: use"
            " simulate or sweep, write the branch that the motion is on (r*sin(theta)), or take"
            ' orientation="quaternion"'
        )
    refuse_sampling(self.controllers, "solve_fn", "use simulate or sweep, or write solve_fn over one period")
    start = None
    if given is not None:
        start = self.derived.start([*given, DIRECTION])
        given = tuple(name for name in start.given if name != DIRECTION)
    options = replace(options, method=self.choose_method(method, *options.tolerances))
    engine = cast("TracedEngine", self.engine)
    hosted = hosted_runs(self, given, method, options, events, reduce) if watching else None
    if hosted is not None:
        return engine.hosted_solve_fn(start, options, hosted, self.derived.dependence)
    if self.stages.reduced.unproven:
        raise OptionError(
            f"solve_fn does not watch constraints that were left out and need not follow everywhere ({self.note}): use"
            " simulate or sweep, or write the scene with constraints that are independent everywhere"
        )
    return engine.solve_fn(start, options, self.inputs, self.derived.dependence)
