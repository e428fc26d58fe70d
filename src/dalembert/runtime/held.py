"""What a compiled model keeps: its program, its engine, and the kernels made on demand."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..arrays import FloatArray
from ..codegen import backend_named
from ..codegen.base import Engine
from ..errors import OptionError, ValueInputError, list_names, unknown_name
from ..integrators.event_code import Event, EventCode, event_list
from ..ir.program import Layout
from ..once import DERIVING, derived_once
from ..reduction.rank import rank_margins
from ..reduction.starting import Start, starting
from ..values import number, tolerances
from . import inputs
from .evaluation import Evaluated
from .events import compiled_events
from .explain import describe_passes, explain
from .reductions import reduction_table

if TYPE_CHECKING:
    from ..pipeline import Stages

__all__ = ["NO_ESTIMATE", "Held", "span_of"]

_MOST_WATCHES = 64
"""Sets of events of which the kernels are kept."""

NO_ESTIMATE = "error_estimate compares motions time by time, which events may end or cut: leave out one of the two"


class Held(Evaluated):
    """A scene compiled for one backend in one formulation, with what was made of it."""

    def __init__(self, stages: Stages, engine: Engine, methods: Mapping[str, str]) -> None:
        self.stages = stages
        self.layout: Layout = stages.program.layout
        self._program = stages.program
        self._engine = engine
        self._methods = methods
        self._starts: dict[frozenset[str], Start] = {}
        self._watches: dict[str, EventCode] = {}
        self._named: dict[int, tuple[Any, EventCode]] = {}

    def _recompiled(self, without: tuple[int, ...], kept: tuple[str, ...] | None = None) -> Any:
        """Return the model of the same scene that enforces fewer constraints, or keeps other first integrals.

        Parameters
        ----------
        without : tuple of int
            Constraints that a run found to follow from the others; they are watched, but not enforced.
        kept : tuple of str, optional
            First integrals that are kept at their initial values; by default as before.

        Raises
        ------
        FormulationError
            Where the formulation cannot keep first integrals.
        """
        raise NotImplementedError

    def _in_elapsed_time(self, watched: Sequence[Any]) -> Any:
        """Return the model of the same scene in which time is counted from the start of each run.

        `watched` are expressions of events and reductions in which time itself occurs.
        """
        raise NotImplementedError

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self._program.name

    @property
    def backend(self) -> str:
        """Name of the backend."""
        return self.stages.rendered.backend

    @property
    def formulation(self) -> str:
        """Name of the formulation."""
        return self._program.formulation

    @property
    def methods(self) -> tuple[str, ...]:
        """Integration methods of the backend; "auto" takes the first."""
        return tuple(self._methods)

    @property
    def source(self) -> str:
        """The generated code that runs by default, by the method "auto" at the default tolerances."""
        return self.stages.rendered.source

    def source_of(self, method: str = "auto", rtol: float = 1e-8, atol: float = 1e-10) -> str:
        """Return the generated code that `simulate` runs by a method at some tolerances.

        Raises
        ------
        OptionError
            For a method that the backend does not have, or tolerances that are not positive.
        """
        rtol, atol = tolerances(rtol, atol)
        return self._engine.source_of(self._method(method, rtol, atol), rtol, atol) or self.source

    @property
    def kernels(self) -> Any:
        """The generated kernels as functions of numba, by name, for people's own compiled code (backend "numba").

        ``prepare(p, c)`` computes constants c (``layout.constants``,) from parameters p (n_p,), ``rhs(t, y, c, out)``
        the rate of the state, and so on: see `source`. numba compiles each when it is first called.

        Raises
        ------
        OptionError
            For another backend, and for scenes whose functions of time a run takes piece by piece.
        """
        return self._engine.functions

    def explain(self, *, passes: bool = False) -> str:
        """Return, in a few lines, what was chosen and why, what was left out, and operation counts.

        Parameters
        ----------
        passes : bool
            Whether to list the passes that made the program, each with its time in all kernels and the operations that
            it removed from each. Passes on steps of integrators, which are made when a run needs them, are not among
            them.
        """
        automatic = {
            rtol: self._engine.automatic(self.methods, rtol, rtol) for rtol in (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
        }
        lines = describe_passes(self.stages) if passes else []
        return "\n".join([explain(self.stages, self._methods, automatic), *lines])

    def __repr__(self) -> str:
        return f"<CompiledModel {self.name!r}: {self.formulation}, {self.backend}>"

    def _outputs(self, kernel: str, t: FloatArray, x: FloatArray, p: FloatArray) -> FloatArray | None:
        c = inputs.constants(self._program, p)
        return self._engine.evaluate(kernel, t, x, c) if kernel in self._program else None

    def _start(self, given: Iterable[str]) -> Start:
        """Return the kernel from given initial values to the state, made once for each set of names."""
        key = frozenset(given)
        return derived_once(self._starts, key, lambda: starting(self.stages.reduced, sorted(key)))

    def _method(self, method: Any, rtol: float, atol: float, *, many: bool = False) -> str:
        if isinstance(method, str) and method == "auto":
            return self._engine.automatic(self.methods, rtol, atol, many=many)
        if not isinstance(method, str) or method not in self._methods:
            why = backend_named(self.backend).refusal(self._program, str(method))
            if why:
                raise OptionError(f"{why}. Take one of: {list_names(['auto', *self._methods])}")
            raise OptionError(
                unknown_name("method", str(method), ["auto", *self._methods]) + f" (of the backend {self.backend!r})"
            )
        return method

    def _events(self, events: Any, reduce: Any = None, *, ranks: bool = False) -> EventCode | None:
        """Return the kernels of events and reductions, made once for each set of them; None where there are none.

        With `ranks` the rank of the constraints is watched too.
        """
        same = isinstance(events, tuple) and reduce is None and not ranks
        same = same and all(isinstance(event, Event) and event.apply is None for event in events)
        kept = self._named.get(id(events)) if same else None
        if kept is not None and kept[0] is events:
            return kept[1]
        listed = event_list(events, self.layout.aliases)
        reductions = reduction_table(reduce, self.layout.aliases)
        with DERIVING:
            margins = rank_margins(self.stages.reduced) if ranks else {}
            if not listed and not reductions and not margins:
                return None
            key = repr((listed, reductions, ranks))
            code = derived_once(
                self._watches,
                key,
                lambda: compiled_events(self.stages, listed, self._start, reductions, margins),
                most=_MOST_WATCHES,
            )
            if same:  # a tuple is kept, so that no other can have its number
                if len(self._named) >= _MOST_WATCHES:
                    self._named.clear()
                self._named[id(events)] = events, code
        return code


def span_of(t_span: Sequence[float]) -> tuple[float, float]:
    """Return start and end of a run as numbers."""
    try:
        t0, t1 = (number(t) for t in t_span)
    except (TypeError, ValueError):
        raise ValueInputError(f"t_span must be two numbers, start and end, not {t_span!r}") from None
    return t0, t1
