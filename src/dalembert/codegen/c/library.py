"""Kernels and steps of programs as C: the engine's own choice of them, with names in place of machine code.

Loops of exports take the arguments that loops of this process take. Where these have addresses of machine code, those
of an export have numbers, by which the names of functions of C are found.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import ClassVar, final

from ...ir.kernel import Kernel
from ...ir.program import Program
from ...methods.tableau import Tableau
from ...subset.arguments import OwnedAddress
from ...transforms.runge_kutta import attempt_kernel, start_kernel
from ...transforms.taylor.recurrences import Recurrences
from ...transforms.taylor.step import step_kernel
from ..library import Code, KernelLibrary
from ..rendering import render
from .kernels import kernel_variables
from .order_loops import order_loop_variables

LARGEST_STRAIGHT = 1000
"""Lines up to which a Taylor step is written out; loops over the orders are shorter, and faster than longer code."""


@final
class CFunctions:
    """The functions of an export that stand for kernels.

    Parameters
    ----------
    prefix : str
        Of their names.

    Attributes
    ----------
    names : dict of int to str
        Names by the numbers that stand for addresses.
    texts : dict of tuple of str to str
        Text of the functions of these names.
    """

    def __init__(self, prefix: str) -> None:
        self.prefix = prefix
        self.names: dict[int, str] = {}
        self.texts: dict[tuple[str, ...], str] = {}
        self._taken: set[str] = set()

    def named(self, wish: str) -> str:
        """Return an unused name."""
        base = name = f"{self.prefix}_{re.sub(r'[^a-z0-9_]', '_', wish.lower())}_kernel"
        count = 1
        while name in self._taken:
            count += 1
            name = f"{base}_{count}"
        self._taken.add(name)
        return name

    def number(self, name: str) -> OwnedAddress:
        """Return a number in place of the address of a function."""
        found = next((number for number, known in self.names.items() if known == name), -1 - len(self.names))
        self.names[found] = name  # no address is negative
        return OwnedAddress(found, self)

    def used(self, text: str) -> str:
        """Return the texts of the functions that a text calls, in the order in which they were made."""
        called = set(re.findall(r"\w+", text))
        return "".join(made for names, made in self.texts.items() if called & set(names))


@final
class _Loaded:
    """Functions of a text, by the names that the library gives them."""

    def __init__(self, functions: CFunctions, names: dict[str, str]) -> None:
        self._functions, self._names = functions, names

    def address(self, name: str) -> OwnedAddress:
        """Return the number of a function."""
        return self._functions.number(self._names[name])


@final
class CLibrary(KernelLibrary):
    """Kernels and steps of one program, as functions of an export; cases run alone.

    Parameters
    ----------
    program : Program
    functions : CFunctions
    """

    compiles_starts: ClassVar[bool] = True

    def __init__(self, program: Program, functions: CFunctions) -> None:
        super().__init__(program, None)
        self._functions, self._names = functions, dict[str, str]()

    @property
    def lanes(self) -> int:
        """See `KernelLibrary.lanes`."""
        return 1

    def source(self, method: str, order: int) -> str:
        """See `KernelLibrary.source`: nothing runs it as a whole."""
        return ""

    def kernel_text(self, name: str, kernel: Kernel, lanes: int, *, exact: bool = False) -> str:
        """See `KernelLibrary.kernel_text`."""
        return self._printed([(name, kernel)], lanes, exact=exact)

    def step_text(self, name: str, known: Recurrences, order: int, lanes: int, *, dense: bool) -> str:
        """See `KernelLibrary.step_text`."""
        if known.unrolled_lines(order) <= LARGEST_STRAIGHT:
            return self._printed([(name, step_kernel(known, order, dense=dense))], lanes)
        return render("c/order_loop.c.j2", order_loop_variables(self._names[name], known, order))

    def attempt_text(self, tableau: Tableau, lanes: int, *, dense: bool, weighted: bool) -> str:
        """See `KernelLibrary.attempt_text`."""
        rhs, about = self._program.kernel("rhs"), {"carried": self.carried, "weighted": weighted}
        attempt = attempt_kernel(rhs, tableau, dense=dense, knots=self.knots, **about)
        return self._printed([("attempt", attempt), ("start", start_kernel(rhs, tableau, **about))], lanes)

    def _printed(self, kernels: list[tuple[str, Kernel]], lanes: int, *, exact: bool = False) -> str:
        found = [
            kernel_variables(self._names[name], kernel, f'"{name}"', exact=exact, lanes=lanes)
            for name, kernel in kernels
        ]
        return render("c/kernels.c.j2", {"kernels": found})

    def _load(self, name: str, lanes: int, text: Callable[[], str], functions: tuple[str, ...]) -> Code:
        """See `KernelLibrary._load`."""
        end = f"_{lanes}" if lanes != 1 else ""
        self._names = {function: self._functions.named(f"{function}{end}") for function in functions}
        self._functions.texts[tuple(self._names.values())] = text()
        return _Loaded(self._functions, self._names)
