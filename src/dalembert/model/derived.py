"""Parts of one model that are derived when first needed, and kept: kernels, facts, and other models of its scene.

Modules that derive them are imported then, because that takes a while.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, final

from ..codegen.engine import Engine
from ..ir.program import DIRECTION
from ..once import BoundedTable, derived_once, derived_property
from ..options import CompileOptions, SweepOptions
from ..pipeline import Compiled, SeveralModes, Stages, compile_equations, compile_scene
from ..reduction.invariants import InvariantCandidates, candidates
from ..reduction.jumps import has_jumps
from ..reduction.starting import Start, starting
from ..runs.partials import Partials
from ..starts.symbol_assumptions import ROUNDING, signed_names

if TYPE_CHECKING:
    from ..analysis.variation import Variation
    from ..codegen.llvm.prepared import AdmissionCode
    from ..events.event_code import EventCode
    from ..reduction.dependent_rows import Redundancy
    from ..runs.case_settings import CaseSettings
    from ..scene import Scene
    from ..starts.initial_states import QuickStart
    from .model import CompiledModel


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
    sweep_settings : table
        Settings of sweeps by options, method and number of threads, with the span of the last ones.
    conserved : table
        Names of the first integrals that are conserved, by the bytes of constants.
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
        self._events: BoundedTable[str, EventCode | None] = BoundedTable(_MOST)
        self._by_tuple: BoundedTable[int, tuple[Any, EventCode]] = BoundedTable(_MOST)
        self.sweep_settings: BoundedTable[tuple[SweepOptions, str, int], tuple[CaseSettings, tuple[float, float]]]
        self.sweep_settings = BoundedTable(_MOST)
        self.conserved: BoundedTable[bytes, tuple[str, ...]] = BoundedTable(_MOST)
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

    def events(
        self, events: Any, reduce: Any = None, *, guards: tuple[str, ...] = (), duration: float = 1.0
    ) -> EventCode | None:
        """Return the kernels of events and reductions, made once for each set of them; None where there are none.

        Cases of sweeps are watched for more: with "ranks" among the `guards` for a lost rank of the constraints, in
        runs of a `duration` [s], with "locks" for angles that lock where positions have a kink, and with "ends" for
        the ends of what positions are defined for.
        """
        same = isinstance(events, tuple) and reduce is None and not guards
        if same and not events:
            return None
        from ..events.event_code import Event

        same = same and all(isinstance(event, Event) and event.apply is None for event in events)
        kept = self._by_tuple.get(id(events)) if same else None
        if kept is not None and kept[0] is events:
            return kept[1]
        from ..events.event_code import event_list
        from ..reduction.margins import end_margins, lock_margins, rank_margins, short_time
        from ..runs.events import compiled_events
        from ..runs.reductions import reduction_table

        aliases = self._stages.program.layout.aliases
        listed, reductions = event_list(events, aliases), reduction_table(reduce, aliases)
        short = short_time(duration) if "ranks" in guards else None

        def made() -> EventCode | None:
            margins = {} if short is None else rank_margins(self._stages.reduced, short)
            margins |= lock_margins(self._stages.reduced) if "locks" in guards else {}
            margins |= end_margins(self._stages.reduced) if "ends" in guards else {}
            if not listed and not reductions and not margins:
                return None
            return compiled_events(self._stages, listed, self.start, reductions, margins)

        code = derived_once(self._events, repr((listed, reductions, guards, short)), made)
        if same and code is not None:  # a tuple is kept, so that no other can have its number
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


MOST_VARIANTS = 16
"""Models made for the events and reductions of runs that are kept: those that were used last."""


@final
class Variants:
    """Other models of the scene of one model, each compiled when it is first needed.

    Parameters
    ----------
    compiled : Stages or SeveralModes
        What the model was made of. One with several modes has only models in elapsed time, with further parameters, and
        on other backends.
    dropped : tuple of int
        Constraints that the model does not enforce, because they follow from the others around the start of a run.
    make : function of compiled stages, or several modes, and dropped constraints
        Makes a model.
    """

    def __init__(
        self,
        compiled: Stages | SeveralModes,
        dropped: tuple[int, ...],
        make: Callable[[Compiled | SeveralModes, tuple[int, ...]], CompiledModel],
    ) -> None:
        self._several = compiled if isinstance(compiled, SeveralModes) else None
        if isinstance(compiled, Stages):
            self._stages = compiled
        self._scene, self._options = compiled.scene, compiled.options
        self._dropped, self._make = dropped, make
        self._tables: dict[tuple[str, tuple[Any, ...]], CompiledModel] = {}
        self._watched: BoundedTable[tuple[str, tuple[Any, ...]], CompiledModel] = BoundedTable(MOST_VARIANTS)

    def without_constraints(self, numbers: Sequence[int]) -> CompiledModel:
        """Return the model that does not enforce some constraints besides those that this one does not enforce."""
        left_out = tuple(sorted({*numbers, *self._stages.reduced.left_out}))
        dropped = tuple(sorted({*numbers, *self._dropped}))
        kept = self._stages.kept
        return self._once("without", left_out, lambda: self._make(self._recompiled(left_out, kept), dropped))

    def enforcing_all(self, redundancy: Redundancy) -> CompiledModel:
        """Return the model that enforces together all constraints of which some follow from others."""
        reduced = self._stages.reduced
        proven = tuple(i for i in reduced.left_out if i not in reduced.unproven)
        return self._once(
            "together", (redundancy,), lambda: self._make(self._recompiled(proven, self._stages.kept, redundancy), ())
        )

    def keeping_invariants(self, names: tuple[str, ...]) -> CompiledModel:
        """Return the model that keeps first integrals at their initial values.

        Raises
        ------
        FormulationError
            Where the formulation cannot keep first integrals.
        """
        left_out = self._stages.reduced.unproven
        return self._once("keeping", names, lambda: self._make(self._recompiled(left_out, names), ()))

    def in_elapsed_time(self, watched: tuple[Any, ...]) -> CompiledModel:
        """Return the model in which time is counted from the start of each run.

        `watched` are expressions of events and reductions in which time itself occurs. It is another scene, which is
        read and derived anew.
        """

        def make() -> CompiledModel:
            return self._of_scene(self._scene.in_elapsed_time(watched))

        return derived_once(self._watched, ("elapsed", watched), make)

    def with_parameters(self, symbols: tuple[Any, ...]) -> CompiledModel:
        """Return the model of the scene with further parameters, which only events and reductions of runs contain."""

        def make() -> CompiledModel:
            scene = self._scene.with_parameters(symbols)
            if self._several is None and self._stages.reduced.redundancy is not None:
                reduced = self._stages.reduced
                return self._of_scene(scene, reduced.left_out, self._dropped, reduced.redundancy)
            left_out = self._stages.reduced.unproven if self._dropped else ()
            return self._of_scene(scene, left_out, self._dropped)

        return derived_once(self._watched, ("parameters", symbols), make)

    def in_formulation(self, name: str) -> CompiledModel:
        """Return the model in another formulation on the same backend, without requested outputs."""
        stages = self._stages
        options = CompileOptions(backend=stages.rendered.backend, formulation=name, cache=stages.options.cache)
        return self._once(
            "formulation",
            (name,),
            lambda: self._make(compile_equations(stages.derivation, options, stages.mode), ()),
        )

    def on_backend(self, name: str) -> CompiledModel:
        """Return the same model on another backend."""
        if self._several is not None:
            there = replace(self._several, options=replace(self._options, backend=name))
            return self._once("backend", (name,), lambda: self._make(there, ()))
        stages = self._stages
        options = replace(stages.options, backend=name, formulation=stages.program.formulation)
        redundancy = stages.reduced.redundancy
        left_out = stages.reduced.unproven if redundancy is None else stages.reduced.left_out
        return self._once(
            "backend",
            (name,),
            lambda: self._make(
                compile_equations(
                    stages.derivation, options, stages.mode, left_out, stages.kept, redundancy=redundancy
                ),
                self._dropped,
            ),
        )

    def in_formulations(self) -> dict[str, CompiledModel]:
        """Return the models in other formulations that have been compiled, by formulation."""
        return {model.formulation: model for (kind, _), model in self._tables.items() if kind == "formulation"}

    def invariant_models(self) -> list[CompiledModel]:
        """Return the models that keep first integrals and have been compiled."""
        return [model for (kind, _), model in self._tables.items() if kind == "keeping"]

    def _of_scene(
        self,
        scene: Scene,
        left_out: tuple[int, ...] = (),
        dropped: tuple[int, ...] = (),
        redundancy: Redundancy | None = None,
    ) -> CompiledModel:
        """Return the model of another scene, in the same mode and with the same first integrals kept."""
        mode, kept = (None, ()) if self._several is not None else (self._stages.mode, self._stages.kept)
        return self._make(compile_scene(scene, self._options, mode, left_out, kept, redundancy), dropped)

    def _once(self, kind: str, key: tuple[Any, ...], make: Callable[[], CompiledModel]) -> CompiledModel:
        return derived_once(self._tables, (kind, key), make)

    def _recompiled(
        self, left_out: tuple[int, ...], kept: tuple[str, ...], redundancy: Redundancy | None = None
    ) -> Compiled:
        """Compile the same equations without some constraints, with kept first integrals, or with dependent rows."""
        stages = self._stages
        options = replace(stages.options, formulation=stages.program.formulation)
        return compile_equations(stages.derivation, options, stages.mode, left_out, kept, redundancy=redundancy)
