"""Steps of fixed size as pure functions, for environments and optimal control."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, final

import jax.numpy as jnp
from jax import lax

from ..codegen.printers import JAX
from ..errors import OptionError, unknown_name
from ..frozen import frozen
from ..ir.program import Program
from ..methods.names import CLASSICAL, EULER, FixedTableau
from .modules import compile_kernel
from .pieces import EXPLICIT, corrections_on_rows, place_of
from .runs.mesh_axes import stack, varying_like
from .runs.pairs import slopes_in_turn
from .runs.precision import contracted
from .runs.step_rules import Projections, Rows, project


def _of_pair(name: str) -> FixedTableau:
    pair = EXPLICIT[name]
    stages = range(pair.end)
    rows = tuple(tuple(float(a) for a in pair.A[i, :i]) for i in stages)
    return FixedTableau(rows, tuple(float(pair.b[i]) for i in stages), tuple(float(pair.c[i]) for i in stages))


STEP_METHODS: Mapping[str, FixedTableau] = {
    "rk4": CLASSICAL,
    "euler": EULER,
    **{name: _of_pair(name) for name in EXPLICIT},
}
"""Explicit methods of fixed steps: order 4, order 1, and those of the pairs."""


@final
@frozen
class Stepper:
    """Steps of a program by one method: `rates` and `projections` work on rows, `place` is that of conditions on time.

    Where conditions are decided, `constants` makes the constants of parameters in each step.
    """

    rates: Callable[..., Rows]
    projections: Projections
    place: int | None
    constants: Callable[[Any], Any]
    tableau: FixedTableau

    @classmethod
    def of(cls, program: Program, constants: Callable[[Any], Any], method: str) -> Stepper:
        """Return the steps of a method.

        Raises
        ------
        OptionError
            For a method that does not exist.
        """
        if method not in STEP_METHODS:
            raise OptionError(unknown_name("method of fixed steps", str(method), STEP_METHODS))
        rates, projections = compile_kernel(program.kernel("rhs"), JAX), corrections_on_rows(program)
        return cls(rates, projections, place_of(program), constants, STEP_METHODS[method])

    def __call__(self, t: Any, y: Any, p: Any, dt: Any, substeps: int) -> Any:
        """Return the state (n_y,) after `substeps` equal steps that together take dt."""
        h = jnp.asarray(dt, dtype=y.dtype) / substeps
        given = jnp.unstack(self.constants(p)) if self.place is None else ()

        def one(carry: tuple[Any, Rows], _: Any) -> tuple[tuple[Any, Rows], None]:
            time, rows = carry
            c = given
            if self.place is not None:
                c = jnp.unstack(self.constants(p.at[self.place].set(time + 0.5 * h)))
            return (time + h, self._step(time, rows, c, h)), None

        start = varying_like((jnp.asarray(t, dtype=y.dtype), tuple(jnp.unstack(y))), (t, y, p, h))
        (_, rows), _ = one(start, None) if substeps == 1 else lax.scan(one, start, None, length=substeps)
        return stack(rows) if rows else y

    def _step(self, t: Any, y: Rows, c: Rows, h: Any) -> Rows:
        slopes = slopes_in_turn(self.rates, self.tableau.rows, self.tableau.nodes, (t, y), h, c)
        new = tuple(a + h * contracted(self.tableau.weights, k) for a, k in zip(y, slopes, strict=True))
        if not self.projections:
            return new
        held, settled = project(self.projections, t + h, new, c)
        return tuple(jnp.where(settled, row, jnp.nan) for row in held)
