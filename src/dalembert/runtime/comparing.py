"""One scene in every formulation, run alike."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ConstraintError, FormulationError, OptionError, unknown_name
from ..reduction import FORMULATIONS
from ..results.comparison import Comparison, ComparisonRow
from ..values import listed

if TYPE_CHECKING:
    from .model import CompiledModel

__all__ = ["compare"]


def compare(
    compiled: Callable[[str], CompiledModel],
    scene: str,
    chosen: Sequence[str] | None,
    run: tuple[Any, Mapping[Any, Any], Mapping[Any, Any]],
    tolerances: tuple[float, float],
    methods: str | Mapping[str, str],
    known: Collection[str],
) -> Comparison:
    """Return the comparison of a run (span, initial values, parameters).

    Parameters
    ----------
    compiled : callable
        Gives the scene's model in a formulation.
    scene : str
        Its name.
    chosen : sequence of str or None
        Formulations; None takes all.
    run : tuple
        Arguments of `CompiledModel.simulate`.
    tolerances : (float, float)
        rtol and atol.
    methods : str or mapping of str to str
        The method for all, or by formulation; those that a formulation does not have become "auto".
    known : collection of str
        Methods of the backend.

    Raises
    ------
    OptionError
        For unknown formulations and methods.
    """
    names = tuple(FORMULATIONS) if chosen is None else tuple(listed("formulations", chosen, "names of formulations"))
    for name in names:
        if not isinstance(name, str) or name not in FORMULATIONS:
            raise OptionError(unknown_name("formulation", str(name), FORMULATIONS))
    if not isinstance(methods, str | Mapping):
        raise OptionError(f"method must be a name, or a mapping from formulations to names, not {methods!r}")
    table = {} if isinstance(methods, str) else dict(methods)
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
            model = compiled(name)
        except (FormulationError, ConstraintError) as reason:
            nothing = (float("nan"),) * 4
            rows.append(ComparisonRow(name, "", "cannot serve", *nothing, 0, 0, float("nan"), str(reason)))
            continue
        rows.append(_row(name, model, run, tolerances, method if method in model.methods else "auto"))
    return Comparison(scene, *tolerances, tuple(rows))


def _row(
    name: str, model: CompiledModel, run: tuple[Any, Any, Any], tolerances: tuple[float, float], method: str
) -> Any:
    rtol, atol = tolerances
    options: dict[str, Any] = {"method": method, "rtol": rtol, "atol": atol}
    found = model.simulate(*run, **options, error_estimate=True)
    begin = time.perf_counter()
    model.simulate(*run, **options)
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
