"""Tables and surfaces of data in SymPy expressions: `TableFunction` of one value or two, and its numbers, `Curve`."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator
from typing import Any, ClassVar, final

import sympy as sp

from ...ir.calls import array_call
from ...ir.surfaces import Surface, array_surface, surface_value
from ...ir.tables import Table, array_value, registered, value

TABLE_CALLS: dict[str, Callable[..., Any]] = {
    "table_value": array_value,
    "surface_value": array_surface,
    "compiled_value": array_call,
}
"""Functions of arrays that `TableFunction.call` and `CompiledCall.call` call, by their names in generated text."""


@final
class Curve(sp.AtomicExpr):  # type: ignore[misc]
    """The numbers of a table or surface in a SymPy expression, with the orders of the derivative that is meant."""

    is_commutative: ClassVar[bool] = True
    is_real: ClassVar[bool] = True
    __slots__ = ("orders", "table")
    orders: tuple[int, ...]
    table: Table | Surface

    def __new__(cls, table: Table | Surface, orders: tuple[int, ...] = ()) -> Curve:
        """Return the derivative of some orders, one for each argument; of a table or surface itself without."""
        made: Curve = sp.AtomicExpr.__new__(cls)
        made.table = registered(table)
        made.orders = orders or (0,) * len(made.axes)
        return made

    def _hashable_content(self) -> tuple[Any, ...]:
        return (self.table.name, self.table.key, self.orders)

    def __getnewargs__(self) -> tuple[Any, ...]:
        return (self.table, self.orders)

    def __getstate__(self) -> None:
        return None

    @property
    def axes(self) -> tuple[Table, ...]:
        """The table itself, or the axes of the surface."""
        return (self.table,) if isinstance(self.table, Table) else self.table.axes

    def derivative(self, place: int) -> Curve | None:
        """Return the derivative by an argument, None where it is zero between the knots."""
        degrees = (self.table.degree,) if isinstance(self.table, Table) else self.table.degrees
        if self.orders[place] >= degrees[place]:
            return None
        return Curve(self.table, tuple(order + (i == place) for i, order in enumerate(self.orders)))

    def sort_key(self, order: Any = None) -> Any:
        """Return the sort key for SymPy."""
        orders = " ".join(map(str, self.orders))
        return self.class_key(), (1, (f"{self.table.name} {orders} {self.table.key}",)), sp.S.One.sort_key(), sp.S.One

    def _mark(self) -> str:
        """Return what stands behind the name: strokes, or orders in parentheses where there are two arguments."""
        if len(self.orders) == 1:
            return "'" * self.orders[0]
        return f"({','.join(map(str, self.orders))})" if any(self.orders) else ""

    def _sympystr(self, printer: Any) -> str:
        mark = self._mark()
        return self.table.name + (f"^{mark}" if mark.startswith("(") else mark)

    def _latex(self, printer: Any) -> str:
        mark, name = self._mark(), str(sp.latex(sp.Symbol(self.table.name)))
        return name + (f"^{{{mark}}}" if mark.startswith("(") else mark)


@final
class TableFunction(sp.Function):  # type: ignore[misc]
    """A table of one expression or a surface over two, or a derivative of it; its last argument is the `Curve`."""

    nargs = (2, 3)
    is_real: ClassVar[bool] = True

    @property
    def curve(self) -> Curve:
        """The numbers."""
        found: Curve = self.args[-1]
        return found

    @property
    def values(self) -> tuple[Any, ...]:
        """What it is a function of."""
        return tuple(self.args[:-1])

    def axes(self) -> Iterator[tuple[Any, Table, int]]:
        """Yield each argument, with the table that has its knots and the order of the derivative by it."""
        return zip(self.values, self.curve.axes, self.curve.orders, strict=True)

    def fdiff(self, argindex: int = 1) -> Any:
        """Return the derivative by an argument."""
        slope = self.curve.derivative(argindex - 1) if argindex < len(self.args) else None
        return sp.S.Zero if slope is None else TableFunction(*self.values, slope)

    def _eval_evalf(self, prec: int) -> Any:
        points = [x.evalf() for x in self.values]
        if not all(x.is_Float or x.is_Integer for x in points):
            return None
        evaluate: Callable[..., float] = value if len(points) == 1 else surface_value
        return sp.Float(evaluate(*map(float, points), self.curve.table.key, *self.curve.orders))

    def call(self, *values: str) -> str:
        """Return the text of a call of one of `TABLE_CALLS`, with the texts of the arguments."""
        name = list(TABLE_CALLS)[len(values) - 1]
        return f"{name}({', '.join([*values, str(self.curve.table.key), *map(str, self.curve.orders)])})"

    def _numpycode(self, printer: Any) -> str:
        return self.call(*map(printer._print, self.values))

    def _sympystr(self, printer: Any) -> str:
        return f"{printer._print(self.curve)}({', '.join(map(printer._print, self.values))})"

    def _latex(self, printer: Any, exp: str | None = None) -> str:
        name = self.curve._latex(printer)
        if exp is not None:
            name = f"{{{name}}}^{{{exp}}}" if "^" in name else f"{name}^{{{exp}}}"
        return rf"{name}{{\left({', '.join(map(printer._print, self.values))} \right)}}"


def outside(node_value: float, table: Table) -> bool:
    """Return whether a table has no value at x."""
    place = bisect_right(table.edges.tolist(), node_value)
    return table.bounded and place in (0, len(table.edges))
