"""Stops of cases with contacts: changes of conditions on time, knots of inputs, and instants of controllers."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..codegen.host_code import columns_at, host_code
from ..contacts.phase_stops import BEFORE_START, PhaseStops
from ..frozen import frozen
from ..ir.conditions import NO_CONDITIONS
from ..reduction.sampling_kernels import SamplingAction
from ..runs.sampling import Sampling
from ..runs.stop_lists import stop_lists
from ..starts.input_values import GivenInputs
from ..stops.breakpoints import CaseBreaks
from ..stops.input_records import no_inputs
from ..stops.stops import CaseStops, StopAction
from ..subset.arguments import OwnedAddress
from .mode_models import ModeModels


@final
@frozen(eq=False)
class Stops:
    """Stops of some cases, as the loop over phases has them.

    `breaks` are the changes of conditions on time, `inputs` values with knots; None without any. In cases that are
    `senseless` (k,) the periods or offsets of controllers make no sense, and nothing acts.
    """

    table: PhaseStops
    breaks: CaseBreaks | None
    inputs: GivenInputs | None
    senseless: NDArray[np.bool_]

    @property
    def acts(self) -> bool:
        """Whether controllers act."""
        return self.table.table.actions.size > 0


def stops_of(
    modes: ModeModels,
    given: GivenInputs | None,
    p: FloatArray,
    spans: tuple[FloatArray, FloatArray],
    t_eval: FloatArray | None = None,
    *,
    many: bool = False,
) -> Stops | None:
    """Return the stops of cases with parameters (k, n_p) of the scene; None where there are none.

    Parameters
    ----------
    modes : ModeModels
    given : GivenInputs or None
        Values of inputs.
    p : ndarray (k, n_p)
        Parameters.
    spans : (ndarray, ndarray)
        Starts and ends (k,) [s].
    t_eval : ndarray (n_t,) or None
        Times to record [s].
    many : bool
        Whether cases with invalid periods are marked.

    Raises
    ------
    BreakTimesError, OptionError
        For stops without end, and controllers in runs backwards in time.
    NoInstants
        For periods that make no sense, unless there are `many` cases.
    """
    breaks, sampling = modes.breaks(p, *spans), modes.sampling
    records = None if given is None else given.records(modes.layout)
    if breaks is None and sampling is None and records is None:
        return None
    k = len(p)
    changes = CaseBreaks.of(NO_CONDITIONS, p, *spans) if breaks is None else breaks
    lists, bad = stop_lists(changes, sampling, p, t_eval, at_start=True, many=many)
    actions = () if sampling is None else sampling.kernels.actions
    own = [] if sampling is None else [(_places(sampling, a), _action_code(modes, sampling, a)) for a in actions]
    place = None if breaks is None else breaks.place
    found = CaseStops(lists, place, tuple(StopAction(places) for places, _ in own), tuple(code for _, code in own))
    listed = found.table(no_inputs() if records is None else records.table(k), k, 0)
    coefficients = np.zeros((0, 0)) if records is None else np.zeros((p.shape[1], k))
    table = PhaseStops(listed._replace(next=np.full(k, BEFORE_START, np.int64)), np.zeros(k), coefficients)
    return Stops(table, breaks, None if records is None else given, bad)


def _places(sampling: Sampling, action: SamplingAction) -> tuple[int, ...]:
    """Return which variables a controller sets."""
    names = sampling.layout.state
    return action.places or tuple(names.index(name) for name in (*action.inputs, *action.states))


def _action_code(modes: ModeModels, sampling: Sampling, action: SamplingAction) -> OwnedAddress:
    """Return code of what a controller sets; that of a Python function is for a case that is alone."""
    engine = modes.engine()
    if action.kernel is not None:
        return engine.code(action.kernel)[0]
    lanes, layout = engine.code(modes.automaton.contact_data)[1], sampling.layout
    places = list(_places(sampling, action))

    def act(t: int, y: int, c: int, s: int, out: int) -> int:
        now, x, p = (
            columns_at(address, rows, lanes)[:, 0]
            for address, rows in ((t, 1), (y, len(layout.state)), (c, len(layout.parameters)))
        )
        columns_at(out, len(places), lanes)[:] = np.nan  # a case whose law fails goes no further
        columns_at(out, len(places), lanes)[:, 0] = sampling.called(action, float(now[0]), x.copy(), p.copy())[places]
        return 0

    return host_code(act)
