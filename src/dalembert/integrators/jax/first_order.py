"""Linear maps whose own derivatives are refused: those of runs that are not recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from ...errors import OptionError
from .linear_maps import LinearMap

__all__ = ["FirstOrder"]


class FirstOrder:
    """A `LinearMap` that does not change with what it hangs on; its transpose is `pulled`.

    Attributes
    ----------
    no_second : str
        Why it has no derivatives of its own.
    """

    no_second = (
        'second derivatives are those of recorded runs: take solve_fn(adjoint="recorded"), or differences of gradients'
    )

    def __call__(self, held: Any, moving: Any) -> Any:
        """See `LinearMap`."""
        raise NotImplementedError

    def pulled(self, held: Any, given: Any) -> Any:
        """Return the cotangents of `moving`, from those of the value."""
        raise NotImplementedError

    @property
    def transposed(self) -> LinearMap:
        """See `LinearMap`."""
        return _Transposed(self)

    def change(self, held: Any, dheld: Any, moving: Any, still: Any) -> Any:
        """See `LinearMap`.

        Raises
        ------
        OptionError
            Always.
        """
        raise OptionError(self.no_second)


@final
@dataclass(frozen=True, eq=False)
class _Transposed(FirstOrder):
    """The transpose of a map."""

    forward: FirstOrder

    @property
    def no_second(self) -> str:  # type: ignore[override]
        """See `FirstOrder`."""
        return self.forward.no_second

    def __call__(self, held: Any, moving: Any) -> Any:
        return self.forward.pulled(held, moving)

    def pulled(self, held: Any, given: Any) -> Any:
        return self.forward(held, given)

    @property
    def transposed(self) -> LinearMap:
        return self.forward
