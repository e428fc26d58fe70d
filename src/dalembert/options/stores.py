"""Options of stored sweeps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, final

from ..errors import OptionError
from ..frozen import frozen
from ..values import flag, whole
from .runs import set_checked


@final
@frozen(eq=False, kw_only=True)
class StoreOptions:
    """Options of stored sweeps; further keyword arguments of `CompiledModel.sweep`.

    Attributes
    ----------
    to : str, Path or zarr store
    chunk : int or None
        Cases of a chunk; None lets the sweep choose it.
    client : distributed.Client or None
        The cluster that computes the chunks; None for this process.
    resume : bool
        Whether an existing store of the same sweep is completed.
    units : mapping of symbols or names to str, or None
        Units of arrays and parameters; None leaves those that a store has.

    Raises
    ------
    OptionError
        For values that are not of the kind that is needed, and a client that is not running.
    """

    to: Any
    chunk: int | None = None
    client: Any = None
    resume: bool = True
    units: Mapping[Any, str] | None = None

    def __post_init__(self) -> None:
        if self.chunk is not None:
            set_checked(self, chunk=whole("chunk", self.chunk))
            if self.chunk < 1:
                raise OptionError(
                    f"chunk must be at least one case, not {self.chunk!r}; leave it out to have it chosen"
                )
        set_checked(self, resume=flag("resume", self.resume))
        status = getattr(self.client, "status", type(self.client).__name__)
        if self.client is not None and status != "running":
            raise OptionError(
                f"client must be a running distributed.Client; this one is {status}. Make a new one, or leave it out"
            )
