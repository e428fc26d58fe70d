"""Kernels and facts of one model that are derived when they are first needed, and kept.

Modules that derive them are imported then, because that takes a while.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, final

from ..codegen.engine import Engine
from ..ir.program import DIRECTION
from ..once import DERIVING, BoundedTable, derived_once, derived_property
from ..pipeline import Stages
from ..reduction.invariants import InvariantCandidates, candidates
from ..reduction.jumps import has_jumps
from ..reduction.starting import Start, starting
from ..runs.partials import Partials
from ..starts.symbol_assumptions import ROUNDING, signed_names

if TYPE_CHECKING:
    from ..analysis.variation import Variation
    from ..codegen.llvm.prepared import AdmissionCode
    from ..events.event_code import EventCode
    from ..starts.initial_states import QuickStart

_MOST = 64
"""Sets of events, of given values and of derivatives of which the kernels are kept."""


@final
class Derived:
    """Kernels and facts that are derived from the stages of a model on demand.

    Attributes
    ----------
    enforced : tuple of int
        Numbers of the constraints that a run enforces and that may depend on each other; none where they are known to
        be independent.
    signed : tuple of str
        Coordinates and first-order states that were declared to have a sign.
    partials : Partials
        Kernels of the program and their derivatives.
    """

    def __init__(self, stages: Stages, engine: Engine) -> None:
        reduced = stages.reduced
        rows = range(len(stages.program.layout.constraints))
        self._stages, self._engine = stages, engine
        self.enforced = () if reduced.regular else tuple(i for i in rows if i not in reduced.left_out)
        layout = stages.program.layout
        self.signed = signed_names(layout.assumptions, (*layout.coordinates, *layout.states))
        self.partials = Partials(stages.program)
        self._starts: BoundedTable[frozenset[str], Start] = BoundedTable(_MOST)
        self._quick_starts: BoundedTable[frozenset[str], QuickStart] = BoundedTable(_MOST)
        self._events: BoundedTable[str, EventCode] = BoundedTable(_MOST)
        self._by_tuple: BoundedTable[int, tuple[Any, EventCode]] = BoundedTable(_MOST)
        self._variations: BoundedTable[tuple[tuple[str, ...], ...], Variation] = BoundedTable(_MOST)

    def start(self, given: Iterable[str]) -> Start:
        """Return the kernel from given initial values to the state, made once for each set of names.

        Among them may be `DIRECTION`, which is left out where nothing depends on it.
        """
        key = frozenset(given)
        if DIRECTION in key and not self._directed:
            key -= {DIRECTION}
        return derived_once(self._starts, key, lambda: starting(self._stages.reduced, sorted(key)))

    @derived_property
    def _directed(self) -> bool:
        """Whether starts may depend on the direction of time."""
        return has_jumps(self._stages.reduced)

    def quick_start(self, given: Iterable[str]) -> QuickStart:
        """Return the start of single runs from given initial values, made once for each set of names."""
        key = frozenset(given)
        found = self._quick_starts.get(key)
        if found is None:
            from ..starts.initial_states import QuickStart

            found = QuickStart(self._engine, self.start(key), len(self._stages.program.layout.state))
            found = self._quick_starts.setdefault(key, found)
        return found

    def events(self, events: Any, reduce: Any = None, *, ranks: float | None = None) -> EventCode | None:
        """Return the kernels of events and reductions, made once for each set of them; None where there are none.

        The rank of the constraints is watched too in runs of a duration `ranks` [s], where that is given.
        """
        same = isinstance(events, tuple) and reduce is None and ranks is None
        if same and not events:
            return None
        from ..events.event_code import Event

        same = same and all(isinstance(event, Event) and event.apply is None for event in events)
        kept = self._by_tuple.get(id(events)) if same else None
        if kept is not None and kept[0] is events:
            return kept[1]
        from ..events.event_code import event_list
        from ..reduction.margins import rank_margins, short_time
        from ..runs.events import compiled_events
        from ..runs.reductions import reduction_table

        aliases = self._stages.program.layout.aliases
        listed, reductions = event_list(events, aliases), reduction_table(reduce, aliases)
        with DERIVING:
            short = None if ranks is None else short_time(ranks)
            margins = {} if short is None else rank_margins(self._stages.reduced, short)
            if not listed and not reductions and not margins:
                return None
            key = repr((listed, reductions, short))
            code = derived_once(
                self._events, key, lambda: compiled_events(self._stages, listed, self.start, reductions, margins)
            )
            if same:  # a tuple is kept, so that no other can have its number
                self._by_tuple[id(events)] = events, code
        return code

    def variation(self, given: tuple[str, ...], of: tuple[str, ...], wrt: tuple[str, ...]) -> Variation:
        """Return the variational equations of values by parameters and given values, made once for each set of them."""
        from ..analysis.variation import vary

        return derived_once(self._variations, (given, of, wrt), lambda: vary(self._stages, given, of, wrt))

    @derived_property
    def admission(self) -> AdmissionCode | None:
        """The test of what prepared runs are given, None where there is nothing to test."""
        from ..codegen.llvm.prepared import AdmissionCode
        from ..reduction.admission import admission_of_state

        reduced, layout = self._stages.reduced, self._stages.program.layout
        kernel, sizes = admission_of_state(reduced, ROUNDING), (len(layout.state), len(layout.parameters))
        if kernel is None:
            return None
        return AdmissionCode(kernel, sizes, self._engine.folder, projected=reduced.projection is not None)

    @derived_property
    def dependence(self) -> Start | None:
        """How many constraints depend on others at a state; None where none can."""
        from ..reduction.admission import dependence

        return dependence(self._stages.reduced)

    @derived_property
    def invariants(self) -> InvariantCandidates:
        """First integrals that may be conserved."""
        return candidates(self._stages.equations)
