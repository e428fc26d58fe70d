"""Method of models that runs many cases: `sweep`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import OptionError, nesting_named
from ..options import StoreOptions, sweep_options
from ..runs.capabilities import refuse_functions
from ..runs.component_tolerances import is_by_name, with_component_names
from ..runs.run_notes import with_lost_reactions
from ..runs.small_motions import warn_of_small_cases
from ..starts.input_values import has_functions, read_inputs, run_span

if TYPE_CHECKING:
    from ..results.cases import CaseSet
    from ..results.sweep import Sweep
    from .model import CompiledModel


@nesting_named
def sweep(
    self: CompiledModel,
    t_span: tuple[Any, Any],
    initial: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
    *,
    inputs: Mapping[Any, Any] | None = None,
    grid: CaseSet | None = None,
    t_eval: Any = None,
    method: str = "auto",
    rtol: float = 1e-8,
    atol: float | str | Mapping[Any, float] = 1e-10,
    max_step: float = np.inf,
    max_steps: int = 1_000_000,
    threads: int | None = None,
    progress: bool = False,
    error_estimate: bool = False,
    events: Any = (),
    reduce: Any = None,
    project_invariants: Any = False,
    to: Any = None,
    chunk: int | None = None,
    client: Any = None,
    resume: bool = True,
    units: Mapping[Any, str] | None = None,
) -> Sweep | Any:
    """Simulate many cases, each with its own steps and status; one that fails never touches its neighbours.

    With contacts all cases that are in one mode run side by side, every time of `t_eval` ends a step, `max_steps`
    counts the steps of all phases together, and `project_invariants` is an error.

    Parameters
    ----------
    t_span : (float or array_like (n_case,), float or array_like (n_case,))
        Start and end [s], for all cases or one each. Late times lose no digits, as for `simulate`.
    initial, parameters : mapping of symbols or names to numbers or array_like (n_case,)
        Scalars serve all cases. A value that is not finite, or of an array one that its symbol excludes, is the
        status of its case, not an error.
    inputs : mapping of symbols or names to numbers, array_like (n_case,), samples or functions, optional
        Every input of the scene, as for `simulate`; records may have one row a case. A function is sampled once for
        all cases, over all their spans; `stats.note` says how many samples there are.
    grid : Grid or CaseSampler, optional
        From ``dalembert.grid(b=..., x_dot=...)``: every combination of some parameters and initial values; or
        random cases from `random_cases` or `sobol_cases`.
    t_eval : array_like (n_t,), optional
        Times to record for all cases; without it, final states only.
    method, rtol, atol, max_step
        As for `simulate`. With ``atol="auto"`` cases that are small, at the start or else at the end and the samples,
        run again, each with one that serves it.
    max_steps : int
        As for `simulate`; but of a case that is cut at breaks or acts of controllers, the attempts within one part
        count, and then the accepted steps of all parts together.
    threads : int, optional
        Threads to use; by default as many as there are processors.
    progress : bool
        Whether to show a bar with cases per second (needs tqdm).
    error_estimate : bool
        Whether to run every case once more at a hundredth of the tolerances, from which
        ``sweep.error_estimate["x"]`` estimates the global errors; NaN where contacts of the two runs do not do the
        same.
    events : sequence of Event, SymPy expressions or names
        Events of every case, as for `simulate`. ``sweep.events["name"]`` has how often each occurred,
        and when first and last.
    reduce : mapping of str to reductions, or sequence of expressions or names
        Reductions of every motion: `dalembert.final`, `minimum`, `maximum`, `mean` and `first_crossing` of
        expressions as in `Event`; a sequence stands for final values. ``sweep.reduced["name"]`` has them, NaN
        for cases that failed.
    project_invariants : bool, str or sequence of str
        First integrals to keep, as for `simulate`: those that are conserved in the first case that can start. A later
        case that does not conserve them is an error.
    to : str, Path or zarr store, optional
        A store in which the results are kept, chunk by chunk (needs the extra ``dask``). The same call continues where
        an earlier one ended.
    chunk : int, optional
        Cases of a chunk; by default as many as take some seconds or 128 MiB.
    client : distributed.Client, optional
        A cluster that computes the chunks; by default this process does.
    resume : bool
        Whether to continue a store of the same sweep; otherwise an existing store is an error.
    units : mapping of symbols or names to str, optional
        Units of what the store holds, and of parameters, as ``to_xarray(units=...)`` of a sweep takes them.

    Returns
    -------
    Sweep
        After Ctrl-C, with the cases that were finished; the others have the status INTERRUPTED. Where `to` is
        given, an ``xarray.Dataset`` in place of it, which reads values from the store when they are needed.

    Raises
    ------
    UnknownNameError, ValueInputError, InitialStateError, OptionError
        For input that is wrong for all cases, and for a store that holds something else.
    MissingExtraError, StoredSweepError
        Where `to` is given: without the packages that it needs, and where chunks could not be computed.

    Examples
    --------
    The pendulum of `Scene`, from a thousand angles::

        angles = np.linspace(0.1, 3, 1000)
        sweep = model.sweep((0, 10), {theta: angles, theta.diff(): 0}, {m: 1, l: 1, g: 9.81})
        sweep.final["theta"], sweep.status  # arrays over the cases
    """
    if self.controllers:
        refuse_functions(self.controllers, "a sweep")
    options = sweep_options(
        method,
        rtol,
        atol,
        max_step,
        max_steps,
        threads,
        error_estimate,
        project_invariants,
        grid=grid,
        t_eval=t_eval,
        progress=progress,
        events=events,
        reduce=reduce,
    )
    if is_by_name(options.atol):
        options = with_component_names(self, options)
    span = None
    if inputs is not None and has_functions(inputs):
        from ..runs.case_settings import spans_of

        span = run_span(inputs, *spans_of(t_span), options)
    given = None if to is not None and span is None else read_inputs(self.layout, self.inputs, inputs, span, many=True)
    if to is None:
        options = options if given is None else replace(options, inputs=given)
        if chunk is not None or client is not None:
            raise OptionError("chunk and client belong to sweeps that are stored: give to= too, or leave them out")
        if units is not None:
            raise OptionError(
                "units= are of sweeps that are stored (to=); give them to to_xarray(units=...) of this one"
            )
        from ..runs.sweep import sweep_cases

        found = sweep_cases(self, t_span, initial, parameters, options)
        if not options.fits_atol:
            warn_of_small_cases(found, options.rtol, options.atol)
        found = with_lost_reactions(self, found)
        return found if given is None else found.with_note(given.note)
    where = StoreOptions(to=to, chunk=chunk, client=client, resume=resume, units=units)
    from ..store.sweep import stored_sweep

    values = inputs if given is None else given.values  # chunks have the samples of all cases
    return stored_sweep(self, (t_span, initial, parameters, values), options, where)
