"""Reductions: numbers that a sweep keeps of every case instead of its motion."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

from ..errors import ExpressionError, OptionError
from ..events.event_code import Event
from ..scene.expressions import symbols_called

if TYPE_CHECKING:
    from ..ir.program import Layout
    from ..model.model import CompiledModel
    from ..results.cases import CaseSet


@final
@dataclass(frozen=True)
class Reduction:
    """A number that comes of a motion: ``kind`` is "final", "minimum", "maximum", "mean" or "first crossing".

    Made by `dalembert.final`, `minimum`, `maximum`, `mean` and `first_crossing`.
    """

    kind: str
    expression: Any
    direction: int = 0

    def event(self, name: str) -> Event:
        """Return the event of a reduction to a first time."""
        return Event(self.expression, direction=self.direction, name=f"first crossing {name!r}")


def final_value(expression: Any) -> Reduction:
    """Return the reduction of a motion to its value at the end, of an expression or a name as in `Event`."""
    return Reduction("final", expression)


def minimum(expression: Any) -> Reduction:
    """Return the reduction of a motion to the least value of an expression or a name, between steps too."""
    return Reduction("minimum", expression)


def maximum(expression: Any) -> Reduction:
    """Return the reduction of a motion to the largest value of an expression or a name, between steps too.

    Examples
    --------
    The largest angle of each of many pendulums, and when it first was above one::

        kept = {"highest": da.maximum(theta), "above": da.first_crossing(theta - 1, direction=1)}
        rates = np.linspace(0, 5, 100)
        sweep = model.sweep((0, 10), {theta: 0, theta.diff(): rates}, {m: 1, l: 1, g: 9.81}, reduce=kept)
        sweep.reduced["highest"], sweep.reduced["above"]  # arrays over the cases
    """
    return Reduction("maximum", expression)


def mean(expression: Any) -> Reduction:
    """Return the reduction of a motion to the mean over time of an expression or a name as in `Event`."""
    return Reduction("mean", expression)


def first_crossing(expression: Any, direction: int = 0) -> Reduction:
    """Return the reduction of a motion to the time [s] at which an expression first changes its sign.

    It is NaN where that does not happen. Expression and direction are as in `Event`; see `maximum` for an example.
    """
    return Reduction("first crossing", expression, direction)


def reduction_table(reduce: Any, aliases: Mapping[str, str]) -> dict[str, Reduction]:
    """Return reductions by name, from a mapping, from expressions and names (for final values), or from None.

    Raises
    ------
    OptionError
        For what is neither, and for a name that occurs twice.
    """
    if reduce is None:
        return {}
    if isinstance(reduce, Mapping):
        given = [(str(name), value) for name, value in reduce.items()]
    elif isinstance(reduce, Iterable) and not isinstance(reduce, str):
        given = [(aliases.get(str(value), str(value)), value) for value in reduce]
        if any(isinstance(value, Reduction) for _, value in given):
            raise OptionError("a reduction needs a name: give reduce={'name': dalembert.maximum(...), ...}")
    else:
        raise OptionError(
            "reduce must map names to dalembert.final, minimum, maximum, mean or first_crossing of expressions, or list"
            f" expressions whose final values are wanted, not {reduce!r}"
        )
    for name, value in given:
        inner = value.expression if isinstance(value, Reduction) else value
        if not isinstance(inner, Hashable):
            raise OptionError(f"reduction {name!r}: the expression must be a name or a SymPy expression, not {inner!r}")
    table = {name: value if isinstance(value, Reduction) else final_value(value) for name, value in given}
    if len(table) < len(given):
        raise OptionError("two reductions have the same name; give reduce= as a mapping with a name for each")
    return table


# Expressions of events and reductions of runs, and the parameters that stand only in them.


def with_event_parameters(
    model: CompiledModel, parameters: Mapping[Any, Any], events: Any, reduce: Any = None, grid: CaseSet | None = None
) -> CompiledModel:
    """Return the model whose parameters include those that events and reductions of a run bring; itself without any.

    They are the symbols of events and reductions that are given, and that the scene does not have. What is given and
    stands nowhere is left for the model to refuse.
    """
    if (reduce is None and isinstance(events, tuple) and not events) or not isinstance(parameters, Mapping):
        return model
    keys, layout = (*parameters, *(grid.names if grid is not None else ())), model.layout
    if len(keys) <= len(layout.given) - len(layout.defaults):
        return model  # none is further where all are given, and names take time
    known = {*layout.parameters, *layout.variables, *layout.state, *layout.inputs}
    names = {str(key) for key in keys}
    further = {name for name in names if layout.aliases.get(name, name) not in known}
    if not further:
        return model
    found = symbols_called(further, watched_expressions(events, reduce, layout.aliases))
    return model.variants.with_parameters(found) if found else model


def watched_expressions(events: Any, reduce: Any, aliases: Mapping[str, str]) -> Iterable[Any]:
    """Yield the expressions of events, of the jumps that they apply, and of reductions."""
    from ..events.event_code import event_list

    for event in event_list(events, aliases):
        yield event.expression
        yield from (event.apply or {}).values()
    for reduction in reduction_table(reduce, aliases).values():
        yield reduction.expression


def moving_events(layout: Layout, events: Any) -> tuple[Event, ...]:
    """Return events, each of which moves in some mode.

    Raises
    ------
    ExpressionError
        For those that are constant along every motion.
    """
    from ..events.event_code import event_list

    listed = event_list(events, layout.aliases)
    for event in listed:
        watched = event.expression
        inside = getattr(watched, "free_symbols", ())
        names = {watched} if isinstance(watched, str) else {str(symbol) for symbol in inside}
        if names <= {*layout.parameters}:
            raise ExpressionError(
                f"event {event.label!r} is constant along every motion, so that nothing can be watched: write it"
                " in coordinates, rates, outputs or time"
            )
    return listed
