"""Jumps of the state at events of users, on coordinates and rates of a scene with contacts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...integrators.event_code import Event
from ...ir.conditions import CONDITION_TIME
from ...ir.interpret import interpret_rows
from .. import inputs

if TYPE_CHECKING:
    from ..model import CompiledModel

__all__ = ["EventJumps"]


@final
class EventJumps:
    """The maps of some events, which the constraints that hold in all modes may forbid.

    Parameters
    ----------
    model : CompiledModel
        Of the mode in which all that can open is open.
    events : iterable of Event
    """

    def __init__(self, model: CompiledModel, events: Iterable[Event]) -> None:
        self._model = model
        jumping = [replace(event, terminal=False) for event in events if event.apply is not None]
        self._codes = {event.label: model.derived.events((event,)) for event in jumping}

    def __bool__(self) -> bool:
        return bool(self._codes)

    def __call__(
        self, label: str, t: FloatArray, x: FloatArray, p: FloatArray, names: Sequence[str]
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return variables (k, 2 n_q + n_z) after an event, and whether the constraints allow them (k,).

        Parameters
        ----------
        label : str
            Name of the event.
        t, x : ndarray (k,), (k, 2 n_q)
            Times [s], coordinates and rates before it.
        p : ndarray (k, n_p)
            Parameters of the scene, of these ``names``.
        """
        program, code = self._model.stages.program, self._codes[label]
        assert code is not None
        kernel, size = code.jumps[0], len(program.layout.state)
        assert kernel is not None
        columns = {name: p[:, i] for i, name in enumerate(names)}
        columns = {name: np.full(len(t), value) for name, value in program.layout.defaults.items()} | columns
        if CONDITION_TIME in columns:
            columns[CONDITION_TIME] = t
        own = np.array([columns[name] for name in program.layout.parameters]).T.reshape(len(t), -1)
        c = inputs.prepare_rows(program, own)
        y = interpret_rows(program.kernel("initial"), t, x, c)
        out = interpret_rows(code.start.kernel, t, interpret_rows(kernel, t, y, c), c)
        checks = out[:, size:]
        allowed = np.all(np.abs(checks[:, ::2]) <= checks[:, 1::2], axis=1) & np.all(np.isfinite(out), axis=1)
        return interpret_rows(program.kernel("expand"), t, out[:, :size], c), allowed
