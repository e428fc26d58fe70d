"""`Sensitivity`: values along a motion and their derivatives, by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

from ..arrays import FloatArray
from ..errors import UnknownNameError, unknown_name
from ..methods.status import Status

__all__ = ["Sensitivity"]


@final
@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Values and their derivatives with respect to parameters and initial values.

    Attributes
    ----------
    t : ndarray (n_t,)
        Recorded times [s]; after a failure they end where the run did.
    of, wrt : tuple of str
        Names of what is differentiated, and with respect to what.
    values : ndarray (n_t, n_of)
    jacobians : ndarray (n_t, n_of, n_wrt)
    status : Status
        How the run ended.
    method : str
        Integration method.
    steps : int
        Accepted steps.
    """

    t: FloatArray
    of: tuple[str, ...]
    wrt: tuple[str, ...]
    values: FloatArray
    jacobians: FloatArray
    status: Status
    method: str
    steps: int
    aliases: Mapping[str, str]

    @property
    def success(self) -> bool:
        """Whether the end of the span was reached."""
        return self.status is Status.SUCCESS

    @property
    def message(self) -> str:
        """The status of the run, as a sentence."""
        return self.status.message

    def value(self, name: Any) -> FloatArray:
        """Return the values (n_t,) of one of `of`, by name or symbol."""
        return self.values[:, self._place(name, self.of)]

    def __getitem__(self, name: Any) -> FloatArray:
        """Return the values (n_t,) of one of `of`, as `value` does."""
        return self.value(name)

    def jacobian(self, of: Any, wrt: Any) -> FloatArray:
        """Return the derivatives (n_t,) of one of `of` with respect to one of `wrt`, by name or symbol."""
        return self.jacobians[:, self._place(of, self.of), self._place(wrt, self.wrt)]

    def _place(self, key: Any, names: tuple[str, ...]) -> int:
        for name in (self.aliases.get(str(key), str(key)), str(key)):
            if name in names:
                return names.index(name)
        raise UnknownNameError(unknown_name("name", str(key), names))

    def __repr__(self) -> str:
        of, wrt = ", ".join(self.of), ", ".join(self.wrt)
        return f"<Sensitivity of {of} with respect to {wrt}: {len(self.t)} times, {self.status.name}>"
