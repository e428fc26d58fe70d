"""Other models of the same scene that runs need: fewer constraints, kept invariants, elapsed time, parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, final

from ..once import BoundedTable, derived_once
from ..options import CompileOptions
from ..pipeline import Compiled, Stages, compile_equations, derive_scene

if TYPE_CHECKING:
    from .model import CompiledModel

__all__ = ["MOST_VARIANTS", "Variants"]

MOST_VARIANTS = 16
"""Models made for the events and reductions of runs that are kept: those that were used last."""


@final
class Variants:
    """Other models of the scene of one model, each compiled when it is first needed.

    Parameters
    ----------
    stages : Stages
        Of the model.
    dropped : tuple of int
        Constraints that the model does not enforce, because they follow from the others around the start of a run.
    make : function of compiled stages and dropped constraints
        Makes a model.
    """

    def __init__(
        self, stages: Stages, dropped: tuple[int, ...], make: Callable[[Compiled, tuple[int, ...]], CompiledModel]
    ) -> None:
        self._stages, self._dropped, self._make = stages, dropped, make
        self._tables: dict[tuple[str, tuple[Any, ...]], CompiledModel] = {}
        self._watched: BoundedTable[tuple[str, tuple[Any, ...]], CompiledModel] = BoundedTable(MOST_VARIANTS)

    def without_constraints(self, numbers: Sequence[int]) -> CompiledModel:
        """Return the model that does not enforce some constraints besides those that this one does not enforce."""
        left_out = tuple(sorted({*numbers, *self._stages.reduced.left_out}))
        dropped = tuple(sorted({*numbers, *self._dropped}))
        kept = self._stages.kept
        return self._once("without", left_out, lambda: self._make(self._recompiled(left_out, kept), dropped))

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
        stages = self._stages

        def make() -> CompiledModel:
            derivation = derive_scene(stages.scene.in_elapsed_time(watched), stages.options)
            seconds = derivation.seconds
            compiled = compile_equations(derivation, stages.options, stages.mode, (), stages.kept, seconds)
            return self._make(compiled, ())

        return derived_once(self._watched, ("elapsed", watched), make)

    def with_parameters(self, symbols: tuple[Any, ...]) -> CompiledModel:
        """Return the model of the scene with further parameters, which only events and reductions of runs contain."""
        stages = self._stages

        def make() -> CompiledModel:
            derivation = derive_scene(stages.scene.with_parameters(symbols), stages.options)
            left_out = stages.reduced.unproven if self._dropped else ()
            compiled = compile_equations(
                derivation, stages.options, stages.mode, left_out, stages.kept, derivation.seconds
            )
            return self._make(compiled, self._dropped)

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
        stages = self._stages
        options = replace(stages.options, backend=name, formulation=stages.program.formulation)
        left_out = stages.reduced.unproven
        return self._once(
            "backend",
            (name,),
            lambda: self._make(
                compile_equations(stages.derivation, options, stages.mode, left_out, stages.kept), self._dropped
            ),
        )

    def in_formulations(self) -> dict[str, CompiledModel]:
        """Return the models in other formulations that have been compiled, by formulation."""
        return {model.formulation: model for (kind, _), model in self._tables.items() if kind == "formulation"}

    def invariant_models(self) -> list[CompiledModel]:
        """Return the models that keep first integrals and have been compiled."""
        return [model for (kind, _), model in self._tables.items() if kind == "keeping"]

    def _once(self, kind: str, key: tuple[Any, ...], make: Callable[[], CompiledModel]) -> CompiledModel:
        return derived_once(self._tables, (kind, key), make)

    def _recompiled(self, left_out: tuple[int, ...], kept: tuple[str, ...]) -> Compiled:
        """Compile the same equations without some constraints and with kept first integrals."""
        stages = self._stages
        options = replace(stages.options, formulation=stages.program.formulation)
        return compile_equations(stages.derivation, options, stages.mode, left_out, kept)
