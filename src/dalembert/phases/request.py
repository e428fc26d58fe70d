"""Requests of motions with contacts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Generic, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..options import SimulateOptions, SweepOptions
from .mode_models import ModeModels
from .output_values import PhaseReductions
from .stops import Stops, stops_of
from .velocity_jumps import EventJumps

OptionsT = TypeVar("OptionsT", SimulateOptions, SweepOptions)


@final
@dataclass(frozen=True, eq=False)
class MotionRequest(Generic[OptionsT]):
    """Request of one motion, or of the cases of a sweep.

    Attributes
    ----------
    modes : ModeModels
    t0, t1 : ndarray (k,)
        Spans [s].
    x : ndarray (k, 2 n_q + n_z)
        Consistent coordinates, rates and first-order states to start from.
    p : ndarray (k, n_p)
        Parameters in the order of the scene.
    status : ndarray (k,) of int
        Of cases that cannot start; RUNNING for the others.
    options : SimulateOptions or SweepOptions
        As `simulate` or `sweep` was given them, with checked `t_eval` and `threads`.
    reductions : PhaseReductions
        With the events that users watch.
    """

    modes: ModeModels
    t0: FloatArray
    t1: FloatArray
    x: FloatArray
    p: FloatArray
    status: NDArray[np.int64]
    options: OptionsT
    reductions: PhaseReductions

    @cached_property
    def parameters(self) -> dict[str, float]:
        """Parameters of the first case by name."""
        return dict(zip(self.modes.layout.parameters, self.p[0].tolist(), strict=True))

    def stops(self, *, many: bool = False) -> Stops | None:
        """Return where the cases stop, see `stops_of`; None where they do not."""
        options, spans = self.options, (self.t0, self.t1)
        return stops_of(self.modes, options.inputs, self.p, spans, options.t_eval, many=many)

    @cached_property
    def jumps(self) -> EventJumps:
        """Maps of the state by the events that users watch."""
        opened, events = self.modes.open_mode, self.reductions.requested
        return EventJumps(self.modes.model(opened), events, self.modes.layout.parameters)

    @property
    def labels(self) -> list[str]:
        """Names of the events that users watch."""
        return [event.label for event in self.reductions.requested]
