"""`Program`: kernels of straight-line code in SSA form, free of SymPy and of the graph."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, final

from .kernel import Kernel

if TYPE_CHECKING:
    from .conditions import Conditions

__all__ = [
    "Layout",
    "Program",
]


@final
@dataclass(frozen=True)
class Layout:
    """What the arrays of a program hold, by name.

    Attributes
    ----------
    coordinates, rates, parameters, unknowns : tuple of str
        Names of q, q_dot, p and of the reaction components.
    state : tuple of str
        Names of the components of y.
    outputs : tuple of str
        Names of the requested outputs.
    constraints : tuple of str
        Labels of the constraints, holonomic ones first.
    holonomic : int
        How many of them are holonomic.
    constants : int
        Length of c: the parameters, then the expressions of parameters alone.
    aliases : mapping of str to str
        Text of a SymPy symbol -> name.
    defaults : mapping of str to float
        Parameters that may be left out, and their values then.
    entries : tuple of str
        Names of other values that a start may be given in.
    assumptions : mapping of str to tuple of str
        Name -> what its symbol was declared to be, such as "positive".
    """

    coordinates: tuple[str, ...]
    rates: tuple[str, ...]
    parameters: tuple[str, ...]
    unknowns: tuple[str, ...]
    undetermined: tuple[str, ...]
    state: tuple[str, ...]
    outputs: tuple[str, ...]
    constraints: tuple[str, ...]
    holonomic: int
    constants: int
    aliases: dict[str, str] = field(hash=False)
    defaults: dict[str, float] = field(default_factory=dict, hash=False)
    entries: tuple[str, ...] = ()
    assumptions: dict[str, tuple[str, ...]] = field(default_factory=dict, hash=False)

    @property
    def initial(self) -> tuple[str, ...]:
        """Names that initial values may have."""
        return (*self.coordinates, *self.rates, *self.entries)


@final
@dataclass(frozen=True)
class Program:
    """The kernels of one scene in one formulation, and what their arrays hold.

    Where the scene is `sudden`, what its series do not show may happen in reactions, too, that no rate depends on.
    `energy_note` is what those are warned of who ask for the energy.
    `conditions` are those that are decided once for each segment of a run, None where there are none.
    """

    name: str
    formulation: str
    layout: Layout
    kernels: tuple[Kernel, ...]
    notes: tuple[str, ...]
    sudden: bool = False
    energy_note: str = ""
    conditions: Conditions | None = None

    def kernel(self, name: str) -> Kernel:
        """Return the kernel called `name`; ``KeyError`` where there is none."""
        for kernel in self.kernels:
            if kernel.name == name:
                return kernel
        raise KeyError(name)

    def __contains__(self, name: object) -> bool:
        return any(kernel.name == name for kernel in self.kernels)

    def __iter__(self) -> Iterator[Kernel]:
        return iter(self.kernels)
