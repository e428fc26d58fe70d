"""Generated kernels of a program on JAX arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, final

import jax
import jax.numpy as jnp

from ...ir.program import Program
from .mesh_axes import stack
from .step_rules import CORRECTIONS, Rows, Tolerances, project

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

    def project(self, t: Any, y: Any, c: Any, before: Any = None, tolerances: Tolerances = (0.0, 0.0)) -> Any:
        """Return y (n_y,) projected onto the constraints, NaN where that does not succeed.

        `before` is the state at the start of a step that ends in y.
        """

        def on_rows(name: str) -> Callable[..., Rows]:
            return lambda t, y, c: (self[name](t, *y, *c),)

        projections = [(on_rows(name), count) for name, count in CORRECTIONS.items() if name in self]
        (projected,), held = project(projections, t, (y,), (c,), () if before is None else (before,), tolerances)
        return jnp.where(held, projected, jnp.nan)
