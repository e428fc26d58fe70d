"""Other models of the same scene that runs need: fewer constraints, kept invariants, elapsed time, parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, final

from ..once import BoundedTable, derived_once
from ..options import CompileOptions
from ..pipeline import Compiled, SeveralModes, Stages, compile_equations, compile_scene

if TYPE_CHECKING:
    from ..reduction.dependent_rows import Redundancy
    from ..scene import Scene
    from .model import CompiledModel

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
