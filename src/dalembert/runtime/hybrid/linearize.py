"""Linearisation of scenes with contacts, in the mode that a state decides."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...ir.conditions import CONDITION_TIME
from ...results.linearization import Linearization
from .. import inputs as run_input
from ..linearize import linearize
from .evaluate import decided_state
from .given_values import start_state

if TYPE_CHECKING:
    from .model import HybridModel

__all__ = ["linearize_mode"]


def linearize_mode(
    model: HybridModel,
    t: float,
    initial: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
    states: Sequence[str] | None,
    outputs: Iterable[Any] | None,
) -> Linearization:
    """Return the linearisation about a state; see `Model.linearize`.

    Raises
    ------
    InitialStateError
        For states that the contacts forbid or do not let go on.
    """
    layout, modes = model.layout, model.modes
    given = model.parameter_values(parameters)
    x = start_state(modes, layout, t, run_input.given_values(layout, initial), given)
    if CONDITION_TIME in given:
        given[CONDITION_TIME] = t
    c = np.array([[given[name] for name in layout.parameters]])
    state = decided_state(modes.decisions, np.array([t]), x[np.newaxis], c, "no motion goes on from")
    mode = modes.automaton.mode(int(state.mode_numbers()[0]))
    added = modes.added(mode, state.directions()[0], state.cases.sides[0], state.cases.rest[0])
    values = given | {name: float(value) for name, value in added.items()}
    start = dict(zip(layout.variables, state.x[0].tolist(), strict=True))
    return linearize(modes.model(mode), t, start, values, states, outputs)
