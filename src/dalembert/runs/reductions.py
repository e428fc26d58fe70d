"""Reductions: numbers that a sweep keeps of every case instead of its motion."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from typing import Any, final

from ..errors import OptionError
from ..events.event_code import Event
from ..frozen import frozen


@final
@frozen
class Reduction:
    """A number computed from a motion: ``kind`` is "final", "minimum", "maximum", "mean" or "first crossing".

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
