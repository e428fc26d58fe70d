"""Tables and surfaces in kernels: [an operation of the graph] -> [search for the piece, and its polynomial].

What varies within a piece is arithmetic alone. A surface is a polynomial of the second argument, whose coefficients are
polynomials of the first; the number of its cell follows from the pieces of both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import final

from ..ir.kernel import Assignment, Operand
from ..ir.surfaces import surface_of, surface_row
from ..ir.tables import ORIGIN, Table, coefficient_row, table_of
from ..naming import Namer


@final
class PieceLines:
    """Writes tables and surfaces, or their derivatives, to the body of a kernel.

    Tables with the same argument and the same edges share the search for the piece.
    """

    def __init__(self, namer: Namer, body: list[Assignment]) -> None:
        self._namer, self._body = namer, body
        self._found: dict[tuple[Operand, bytes], str] = {}

    def table(self, x: Operand, key: Operand, order: Operand) -> Operand:
        """Write a table as the polynomial of the piece that x lies in; return its value."""
        key, order = _number(key), int(_number(order))
        table = table_of(key)
        place, powers = self._place(x, table), table.degree - order + 1
        return self._polynomial(
            [partial(self._entry, place, key, coefficient_row(order, n)) for n in range(powers)],
            lambda: self._distance(x, place, key),
        )

    def surface(self, x: Operand, y: Operand, key: Operand, first: Operand, second: Operand) -> Operand:
        """Write a surface as the polynomial of the cell that (x, y) lies in; return its value."""
        key, i, j = _number(key), int(_number(first)), int(_number(second))
        surface = surface_of(key)
        (across, along), degrees = surface.axes, surface.degrees
        column, row = self._place(x, across), self._place(y, along)
        cell = self._write("cell", "add", self._write("cell", "mul", column, float(surface.columns)), row)
        s = self._distance(x, column, float(across.key)) if degrees[0] > i else 0.0

        def in_x(b: int) -> Operand:
            rows = [surface_row(i, j, a, b) for a in range(degrees[0] - i + 1)]
            return self._polynomial([partial(self._entry, cell, key, n) for n in rows], lambda: s)

        return self._polynomial(
            [partial(in_x, b) for b in range(degrees[1] - j + 1)],
            lambda: self._distance(y, row, float(along.key)),
        )

    def _polynomial(self, numbers: Sequence[Callable[[], Operand]], variable: Callable[[], Operand]) -> Operand:
        """Write a polynomial by Horner's scheme, lowest power first."""
        value = numbers[-1]()
        if len(numbers) == 1:
            return value
        s = variable()
        for number in numbers[-2::-1]:
            value = self._write("z", "mul", value, s)
            value = self._write("z", "add", value, number())
        return value

    def _place(self, x: Operand, table: Table) -> str:
        same = x, table.edges.tobytes()
        return self._found.get(same) or self._found.setdefault(same, self._write("piece", "piece", x, float(table.key)))

    def _distance(self, x: Operand, place: Operand, key: float) -> Operand:
        return self._write("z", "sub", x, self._entry(place, key, ORIGIN, "origin"))

    def _entry(self, place: Operand, key: float, row: int, name: str = "number") -> str:
        return self._write(name, "entry", place, key, float(row))

    def _write(self, name: str, op: str, *args: Operand) -> str:
        target = self._namer(name)
        self._body.append(Assignment(target, op, args))
        return target


def _number(operand: Operand) -> float:
    assert not isinstance(operand, str)
    return operand
