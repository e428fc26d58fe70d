"""Kernels of a program on JAX arrays, and their constants along a run, with derivatives by all of them.

The constants (n_c,) of a run are one array: first those of the kernels, whose last one is the start of the run where
kernels depend on time or steps end at breaks; then records of inputs; then weights of functions that users give.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, final

import jax
import jax.numpy as jnp
from jax import lax

from ...frozen import frozen
from ...ir.program import Program
from ...methods.names import CORRECTIONS
from .mesh_axes import stack
from .step_rules import Projections, Rows, Tolerances, project

Reading = Callable[[Rows, Any, Any], Rows]


@final
@frozen
class TracedInputs:
    """The record of an input among the constants of a run: knots (n,), then polynomials (n + 1, width).

    Knots are times since the start of the run, as its breaks are; the knots that polynomials count from are true times.

    Attributes
    ----------
    first : int
        Number of the constant that is the first knot; the polynomial before it comes first.
    knots, width : int
        n, and how many numbers of a polynomial there are.
    place : int
        Number of the first of the constants of kernels that a polynomial sets.
    """

    first: int
    knots: int
    width: int
    place: int

    @property
    def polynomials(self) -> int:
        """Number of the constant at which the polynomials begin."""
        return self.first + self.knots

    @property
    def end(self) -> int:
        """Number of the constant behind the record."""
        return self.polynomials + (self.knots + 1) * self.width

    def piece(self, knots: Any, t: Any) -> Any:
        """Return the number of the polynomial at times t: at a knot, that which follows in time."""
        return jnp.searchsorted(lax.stop_gradient(knots), lax.stop_gradient(t), side="right")

    def at(self, c: Any, t: Any) -> Any:
        """Return the numbers of the constants (*t, width) that hold the polynomials at times t since the start."""
        found = self.piece(c[self.first : self.polynomials], t)
        return self.polynomials + found[..., jnp.newaxis] * self.width + jnp.arange(self.width)


@final
@frozen
class RunConstants:
    """The layout of the constants of a run.

    Attributes
    ----------
    place : int or None
        Number of the constant which is the middle of a step, in true time; None where there is none.
    count : int
        How many constants kernels take, where there are tables or weights.
    tables : tuple of InputTable
    weights : int
        How many numbers behind the tables are weights.
    weighted : bool
        Whether kernels get an array of weights behind their constants, be they none.
    """

    place: int | None = None
    count: int = 0
    tables: tuple[TracedInputs, ...] = ()
    weights: int = 0
    weighted: bool = False

    @property
    def broken(self) -> bool:
        """Whether constants change at the breaks of a run."""
        return self.place is not None or bool(self.tables)

    @property
    def extended(self) -> bool:
        """Whether there are more constants than kernels take."""
        return bool(self.tables) or self.weighted

    def rows(self, c: Any, t: Any) -> Rows:
        """Return the constants of kernels in steps with the middles t (k,), times since the start of the run."""
        if not self.extended:
            rows = tuple(c)
            return rows if self.place is None else (*rows[: self.place], rows[-1] + t, *rows[self.place + 1 :])
        given = list(c[: self.count])
        if self.place is not None:
            given[self.place] = given[-1] + t
        return self._filled(given, c, c, t)

    def kernel_rows(self, rows: Any, c: Any, t: Any) -> Any:
        """Return constants of kernels (n_t, n) or (n,) with those of inputs, at times t (n_t,) since the start."""
        rows = jnp.broadcast_to(rows, (len(t), rows.shape[-1]))
        for table in self.tables:
            rows = rows.at[:, table.place : table.place + table.width].set(c[table.at(c, t)])
        return rows

    def changes(self, dc: Any, c: Any, t: Any, like: Rows) -> Rows:
        """Return changes (n_c,) of constants c as those of `rows`, shaped `like` these."""
        rows = self._filled(list(dc[: self.count]), dc, c, t) if self.extended else dc
        return tuple(jnp.broadcast_to(change, jnp.shape(row)) for change, row in zip(rows, like, strict=True))

    def summed(self, total: Any, share: Rows, c: Any, t: Any) -> Any:
        """Return cotangents (n_c,) of constants c, with those of `rows` added."""
        if not self.extended:
            return total + jnp.stack([jnp.sum(row) if jnp.ndim(row) else jnp.asarray(row) for row in share])
        rows = list(share[: self.count])
        for table in self.tables:
            columns = range(table.place, table.place + table.width)
            numbers = table.at(c, t)
            total = total.at[numbers].add(jnp.stack([rows[i] for i in columns], axis=-1))
            for i in columns:
                rows[i] = jnp.zeros(())
        total = total.at[: self.count].add(jnp.stack([jnp.sum(row) for row in rows]))
        return total.at[len(total) - self.weights :].add(share[-1]) if self.weighted else total

    def reading(self, c: Any, breaks: Any, t0: Any, t1: Any) -> Reading:
        """Return a function from constants as a loop has them, middles between breaks and breaks passed to `rows`.

        Parameters
        ----------
        c, breaks, t0, t1
            Of one run (n_c,), (n,), (), (), or of many (k, n_c), (n, k), (k,), (k,).
        """
        ends = jnp.isfinite(breaks)
        edges = jnp.concatenate([t0[jnp.newaxis], jnp.where(ends, breaks, t1), t1[jnp.newaxis]])
        middles = edges[:-1] + 0.5 * (edges[1:] - edges[:-1])
        many = jnp.ndim(t0) > 0
        pieces = [self._pieces(table, c, middles, many=many) for table in self.tables]
        return self._many(pieces) if many else self._one(pieces)

    def split(self, c: Any) -> Rows:
        """Return constants (n_c,) or (k, n_c) as loops have them.

        Those of one run are one array, of many one for each constant of the kernels; what is more is one array behind.
        """
        if not self.extended:
            return (c,) if jnp.ndim(c) == 1 else tuple(c.T)
        if jnp.ndim(c) == 1:
            return (c,) if self.broken else (c[: self.count], c[self.count :])
        return (*c[:, : self.count].T, c[:, self.count :])

    def _filled(self, given: list[Any], values: Any, c: Any, t: Any) -> Rows:
        """Return constants of kernels with those that the records among `values` (n_c,) have at times; weights last."""
        for table in self.tables:
            found = values[table.at(c, t)]
            given[table.place : table.place + table.width] = [found[..., i] for i in range(table.width)]
        return (*given, values[len(values) - self.weights :]) if self.weighted else tuple(given)

    def _pieces(self, table: TracedInputs, c: Any, middles: Any, *, many: bool) -> Any:
        """Return the number of the polynomial between any two breaks (n + 1,) or (n + 1, k)."""
        if not many:
            return table.piece(c[table.first : table.polynomials], middles)
        return jax.vmap(table.piece)(c[:, table.first : table.polynomials], middles.T).T

    def _one(self, pieces: list[Any]) -> Reading:
        def read(c: Rows, middle: Any, passed: Any) -> Rows:
            (whole,) = c
            given = whole[: self.count] if self.extended else whole
            if self.place is not None:
                given = given.at[self.place].set(given[-1] + middle)
            for table, numbers in zip(self.tables, pieces, strict=True):
                first = table.polynomials + numbers[passed] * table.width
                polynomial = lax.dynamic_slice(whole, (first,), (table.width,))
                given = lax.dynamic_update_slice(given, polynomial, (table.place,))
            return (given, whole[len(whole) - self.weights :]) if self.weighted else (given,)

        return read

    def _many(self, pieces: list[Any]) -> Reading:
        def read(c: Rows, middle: Any, passed: Any) -> Rows:
            given = list(c[: self.count] if self.extended else c)
            if self.place is not None:
                given[self.place] = given[-1] + middle
            cases = jnp.arange(len(passed))
            for table, numbers in zip(self.tables, pieces, strict=True):
                first = table.polynomials - self.count + numbers[passed, cases] * table.width
                for i in range(table.width):
                    given[table.place + i] = c[-1][cases, first + i]
            return (*given, c[-1][:, c[-1].shape[1] - self.weights :]) if self.weighted else tuple(given)

        return read


Function = Callable[..., tuple[Any, ...]]


OnArrays = Callable[[Any, Any, Any], Any]


def stacked(kernel: Function) -> OnArrays:
    """Return a kernel as a function from arrays to an array, in the precision of its argument y."""

    def on_arrays(t: Any, y: Any, c: Any) -> Any:
        y, c = jnp.asarray(y), jnp.asarray(c)
        kind = jnp.result_type(y, c)
        outputs = kernel(t, jnp.unstack(y), jnp.unstack(c))
        return stack([jnp.asarray(output, dtype=kind) for output in outputs]) if outputs else jnp.zeros(0, kind)

    return on_arrays


def on_one_row(kernel: OnArrays) -> Function:
    """Return a kernel on arrays as a function of rows, of which there is one."""
    return lambda t, y, c: (kernel(t, y[0], c[0]),)


@final
class ArrayKernels:
    """The kernels of one program, on arrays.

    Parameters
    ----------
    program : Program
        What the functions were rendered from.
    namespace : mapping of str to callable
        The generated functions by name.
    """

    def __init__(self, program: Program, namespace: Mapping[str, Any]) -> None:
        self.program = program
        self._functions = {k.name: jax.jit(stacked(namespace[k.name])) for k in program if k.name != "prepare"}
        self._prepare: Function | None = namespace.get("prepare")

    def __contains__(self, name: object) -> bool:
        return name in self._functions

    def __getitem__(self, name: str) -> OnArrays:
        return self._functions[name]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the kernels of (t, y, c)."""
        return tuple(self._functions)

    def constants(self, p: Any) -> Any:
        """Return the constants c (n_c,) of parameters p (n_p,)."""
        p = jnp.asarray(p)
        if self._prepare is None or not self.program.layout.constants:
            return p
        return stack([jnp.asarray(output, dtype=p.dtype) for output in self._prepare(jnp.unstack(p))])

    @property
    def projected(self) -> bool:
        """Whether accepted steps are projected onto constraints."""
        return "project_position" in self or "project_velocity" in self

    @property
    def correction_operations(self) -> int:
        """Operations of all corrections that follow a step."""
        kernels = ((self.program.kernel(name), n) for name, n in CORRECTIONS.items() if name in self.program)
        return sum(len(kernel.body) * count for kernel, count in kernels)

    @property
    def projections(self) -> Projections:
        """The corrections of one case, on one row that holds all components."""
        return [(on_one_row(self[name]), count) for name, count in CORRECTIONS.items() if name in self]

    def project(self, t: Any, y: Any, c: Any, before: Any = None, tolerances: Tolerances = (0.0, 0.0)) -> Any:
        """Return y (n_y,) projected onto the constraints, NaN where that does not succeed.

        `before` is the state at the start of a step that ends in y.
        """
        (projected,), held = project(self.projections, t, (y,), (c,), () if before is None else (before,), tolerances)
        return jnp.where(held, projected, jnp.nan)
