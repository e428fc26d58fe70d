"""Comparison of formulations: one run of one scene in each of them."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..codegen import backend_named
from ..errors import ConstraintError, FormulationError, OptionError, unknown_name
from ..options import known_components, within
from ..reduction import FORMULATIONS
from ..results.analyses import Comparison, ComparisonRow
from ..values import listed

if TYPE_CHECKING:
    from ..model.model import CompiledModel


def compare(
    model: CompiledModel,
    run: tuple[Any, Mapping[Any, Any], Mapping[Any, Any], Mapping[Any, Any] | None],
    tolerances: tuple[float, float],
    chosen: Sequence[str] | None,
    methods: str | Mapping[str, str],
) -> Comparison:
    """Return the comparison of a run (span, initial values, parameters, inputs).

    See `CompiledModel.compare_formulations`.

    Parameters
    ----------
    model : CompiledModel
        The scene in one of its formulations.
    run : tuple
        Arguments of `CompiledModel.simulate`.
    tolerances : (float, float)
        rtol and atol; by name, each formulation takes those of the components of its state.
    chosen : sequence of str or None
        Formulations; None takes all.
    methods : str or mapping of str to str
        The method for all, or by formulation; those that a formulation does not have become "auto".

    Raises
    ------
    OptionError, UnknownNameError
        For unknown formulations, methods and names of components.
    """
    layout, (rtol, atol) = model.layout, tolerances
    atol = known_components(atol, dict.fromkeys((*layout.variables, *layout.state)), layout.aliases, {})
    names = tuple(FORMULATIONS) if chosen is None else tuple(listed("formulations", chosen, "names of formulations"))
    for name in names:
        if not isinstance(name, str) or name not in FORMULATIONS:
            raise OptionError(unknown_name("formulation", str(name), FORMULATIONS))
    if not isinstance(methods, str | Mapping):
        raise OptionError(f"method must be a name, or a mapping from formulations to names, not {methods!r}")
    table, known = {} if isinstance(methods, str) else dict(methods), backend_named(model.backend).methods
    strange = [unknown_name("formulation", str(name), FORMULATIONS) for name in table if name not in FORMULATIONS]
    strange += [
        unknown_name("method", str(name), ["auto", *known])
        for name in dict.fromkeys([methods] if isinstance(methods, str) else table.values())
        if name not in ("auto", *known)
    ]
    if strange:
        raise OptionError("\n".join(strange))
    rows = []
    for name in names:
        method = methods if isinstance(methods, str) else methods.get(name, "auto")
        try:
            other = model if name == model.formulation else model.variants.in_formulation(name)
        except (FormulationError, ConstraintError) as reason:
            nothing = (float("nan"),) * 4
            rows.append(ComparisonRow(name, "", "not supported", *nothing, 0, 0, float("nan"), str(reason)))
            continue
        own = rtol, within(atol, other.layout.state)
        rows.append(_row(name, other, run, own, method if method in other.methods else "auto"))
    return Comparison(model.name, rtol, atol, tuple(rows))


def _row(
    name: str, model: CompiledModel, run: tuple[Any, Any, Any, Any], tolerances: tuple[float, float], method: str
) -> Any:
    rtol, atol = tolerances
    *given, inputs = run
    options: dict[str, Any] = {"inputs": inputs, "method": method, "rtol": rtol, "atol": atol}
    found = model.simulate(*given, **options, error_estimate=True)
    begin = time.perf_counter()
    model.simulate(*given, **options)
    seconds = time.perf_counter() - begin
    holonomic = model.layout.holonomic
    energy = found["energy"]
    error = float("nan")
    if found.success:
        error = max(
            (float(np.max(found.error_estimate[q], initial=0.0)) for q in model.layout.coordinates), default=0.0
        )
    return ComparisonRow(
        formulation=name,
        method=found.stats.method,
        status=found.status.name,
        error=error,
        position_violation=float(np.max(np.abs(found.constraint_violation[:, :holonomic]), initial=0.0)),
        velocity_violation=float(np.max(np.abs(found.velocity_violation), initial=0.0)),
        energy_drift=float(np.max(np.abs(energy - energy[0]), initial=0.0)),
        steps=found.stats.steps,
        rejected=found.stats.rejected,
        seconds=seconds,
        note=found.stats.note,
    )
