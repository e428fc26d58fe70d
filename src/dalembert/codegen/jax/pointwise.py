"""Functions of one state of a model, for JAX programs of users."""

from __future__ import annotations

from typing import Any, final

import jax.numpy as jnp

from ...errors import OptionError, list_names
from ...ir.program import Program, representative
from .modules import kernels_of

__all__ = ["VectorField", "checked"]


def checked(kind: str, values: Any, names: tuple[str, ...]) -> Any:
    """Return values (n,) in the order of `names` as an array of floating point numbers, its length checked."""
    array = jnp.asarray(values)
    if array.shape != (len(names),):
        raise OptionError(f"{kind}s must have shape ({len(names)},), for {list_names(names)}, not {array.shape}")
    return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(float)


@final
class VectorField:
    """``field(t, y, args)`` is dy/dt (n_y,) of the state y (n_y,) at parameters args (n_p,).

    Fields of equal programs are equal, so that what JAX compiled for one serves the other.

    Parameters
    ----------
    program : Program
        The compiled program.
    """

    def __init__(self, program: Program) -> None:
        self._program = representative(program)
        self._hash = hash(("vector field", self._program))
        self._kernels = kernels_of(self._program)

    def __call__(self, t: Any, y: Any, args: Any) -> Any:
        """Return the rates; see the class.

        Raises
        ------
        OptionError
            For a state or parameters of another length.
        """
        layout, conditions = self._program.layout, self._program.conditions
        y, p = checked("component of the state", y, layout.state), checked("parameter", args, layout.parameters)
        if conditions is not None:
            p = p.at[conditions.place].set(t)
        return self._kernels["rhs"](t, y, self._kernels.constants(p))

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, VectorField) and self._program is other._program)

    def __hash__(self) -> int:
        return self._hash

    def __reduce__(self) -> tuple[Any, ...]:
        return VectorField, (self._program,)
