"""Compiled kernels and integrator steps of one program, compiled on first use."""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Protocol

from ..ir.kernel import Kernel, calls_in
from ..ir.program import Program
from ..methods.tableau import Tableau
from ..once import BoundedTable, computed_once, once_property
from ..reduction.starting import Start
from ..subset.arguments import NO_CODE, OwnedAddress
from ..transforms.partials import jacobian_kernel, tangent_kernel
from ..transforms.taylor.periodic import angles_of
from ..transforms.taylor.recurrences import Recurrences, recurrences
from ..transforms.taylor.residual_control import cost
from ..transforms.taylor.roots_at_rest import roots_vanish_at_rest
from ..transforms.taylor.step import STEP_ARGUMENTS

_LARGEST_JACOBIAN = 6000
"""Lines of a right-hand side times columns up to which its Jacobian is one kernel: half a second of compilation there,
and some five times faster than column by column (measured on chains of pendulums)."""
_WEIGHTED = "_weighted"
"""End of the names of steps with an absolute tolerance for each component of the state."""
_LARGEST_REPEATED = 100_000
"""Lines of a Taylor step, unrolled, that is compiled to pass where constraints lose rank: some five seconds."""

LARGEST_UNROLLED = 15_000
"""Lines of the recurrences, written out, up to which Taylor steps are worth their compilation."""
MOST_FURTHER = 256
"""Pieces of code of events, reductions, outputs and given values that are kept of a model, some 50 kB each: those that
were used last. Others are unloaded with what still runs them."""


class Code(Protocol):
    """Loaded machine code, which lives as long as an address of it."""

    def address(self, name: str) -> OwnedAddress:
        """Return the address of a function ``void name(double *t, double *y, double *c, double *s, double *out)``."""
        ...


class KernelLibrary(ABC):
    """Compiled kernels and steps of one program; a subclass says how their text is printed and compiled.

    Parameters
    ----------
    program : Program
        Whose right-hand side is integrated.
    folder : Path or None
        Where compiled code is kept; None keeps nothing.
    """

    def __init__(self, program: Program, folder: Path | None) -> None:
        self._program, self.folder = program, folder
        self._lines: dict[int, int] = {}
        self._loaded: dict[tuple[str, int], Code] = {}
        self._further: BoundedTable[tuple[str, int], Code] = BoundedTable(MOST_FURTHER)
        self._event_steps: BoundedTable[tuple[int, int, int, bool], tuple[Kernel, OwnedAddress]]
        self._event_steps = BoundedTable(MOST_FURTHER)

    # -- what a backend supplies ------------------------------------------------------------

    @property
    @abstractmethod
    def lanes(self) -> int:
        """Number of cases that the code of sweeps takes side by side."""

    @abstractmethod
    def source(self, method: str, order: int) -> str:
        """Return the text that single runs by a method take; `order` is that of "taylor"."""

    @abstractmethod
    def kernel_text(self, name: str, kernel: Kernel, lanes: int, *, exact: bool = False) -> str:
        """Return the text of a kernel under a name; where `exact`, sines and cosines are those of the C library."""

    @abstractmethod
    def step_text(self, name: str, known: Recurrences, order: int, lanes: int, *, dense: bool) -> str:
        """Return the text of a Taylor step under a name; with `dense`, of one that also writes its series."""

    @abstractmethod
    def attempt_text(self, tableau: Tableau, lanes: int, *, dense: bool, weighted: bool) -> str:
        """Return the text of the functions ``attempt`` and ``start`` of `dalembert.transforms.runge_kutta`."""

    @abstractmethod
    def _load(self, name: str, lanes: int, text: Callable[[], str], functions: tuple[str, ...]) -> Code:
        """Return the code of these functions of a text, from the cache on disk under a name where it is there."""

    @property
    def functions(self) -> Any:
        """The kernels of the program as functions that people's own code calls, None where the backend has none."""
        return None

    compiles_starts: ClassVar[bool] = False
    """Whether kernels are compiled so fast that the start of single runs is worth it."""

    # -- addresses --------------------------------------------------------------------------

    def taylor(self, order: int, lanes: int, *, dense: bool, weighted: bool = False) -> OwnedAddress:
        """Return the address of a Taylor step; with `dense`, one that also writes its series.

        Where steps are `weighted`, here and below, each component of the state has an absolute tolerance of its own.
        """
        name = self._taylor_name(order, dense, weighted)
        return self._entry(name, lanes, lambda: self._taylor_text(order, lanes, dense, weighted), name)

    def with_event_series(
        self, joint: Kernel, count: int, order: int, lanes: int, *, weighted: bool = False
    ) -> OwnedAddress:
        """Return the address of a Taylor step that writes its series and those of events.

        `joint` is a right-hand side with so many further outputs, which are the events; the step takes and
        writes them as integrals behind the state.
        """

        def make() -> tuple[Kernel, OwnedAddress]:
            def text() -> str:
                limited = self._program.nonanalytic
                known = recurrences(joint, count, step_growth_limited=limited, weighted=weighted)
                return self.step_text("step", known, order, lanes, dense=True)

            name = f"with_event_series{order}{_WEIGHTED * weighted}_{joint.digest}_{count}"
            return joint, self._entry(name, lanes, text, "step", table=self._further)

        # the kernel is kept alive, so that no other has the same id
        return computed_once(self._event_steps, (id(joint), order, lanes, weighted), make)[1]

    def attempt(
        self, tableau: Tableau, lanes: int, *, dense: bool, weighted: bool = False
    ) -> tuple[OwnedAddress, OwnedAddress]:
        """Return the addresses of one attempt of a Runge-Kutta step, and of what precedes the first."""

        def text() -> str:
            return self.attempt_text(tableau, lanes, dense=dense, weighted=weighted)

        name = f"{tableau.name}{'_dense' if dense else ''}{_WEIGHTED * weighted}"
        both = ("attempt", "start")
        attempt, start = (self._entry(name, lanes, text, function, both) for function in both)
        return attempt, start

    def beginning(self, tableau: Tableau, lanes: int, *, weighted: bool) -> OwnedAddress:
        """Return the address of what precedes the first attempt, where no attempt is made."""
        return self.attempt(tableau, lanes, dense=False, weighted=weighted)[1]

    def kernel(self, name: str, lanes: int = 1) -> OwnedAddress:
        """Return the address of a kernel of the program, 0 where it has none of that name."""
        if name not in self._program:
            return NO_CODE
        return self._entry(name, lanes, lambda: self._program_text(name, lanes), name)

    def prepare(self, lanes: int = 1) -> OwnedAddress:
        """Return the address of the kernel that computes constants (last argument) from parameters (first)."""
        return self.kernel("prepare", lanes)

    def start(self, start: Start, lanes: int) -> OwnedAddress:
        """Return the address of the kernel that makes states, with their checks, from given values."""
        what, kernel = start.kernel.name, replace(start.kernel, arguments=STEP_ARGUMENTS)
        name = f"{what}_{hashlib.sha256(' '.join(start.given).encode()).hexdigest()[:16]}"
        return self._entry(
            name, lanes, lambda: self.kernel_text(what, kernel, lanes, exact=True), what, table=self._further
        )

    def extra_kernel(self, kernel: Kernel, lanes: int) -> OwnedAddress:
        """Return the address of a kernel of (t, y, c) that is not the program's own."""
        kernel = replace(kernel, arguments=STEP_ARGUMENTS)
        name = f"{kernel.name}_{kernel.digest}"
        return self._entry(
            name, lanes, lambda: self.kernel_text(kernel.name, kernel, lanes), kernel.name, table=self._further
        )

    def derivative(self, name: str, lanes: int = 1) -> tuple[OwnedAddress, OwnedAddress]:
        """Return the addresses of the derivative of a kernel by all of its state.

        The first is the whole Jacobian, the second one column after the other (see `dalembert.transforms.partials`);
        one of them is 0.
        """
        whole = has_jacobian(self._program.kernel(name))
        made = f"{name}_{_DERIVATIVES[whole]}"
        address = self._entry(made, lanes, lambda: self._derivative_text(name, lanes), made)
        return (address, NO_CODE) if whole else (NO_CODE, address)

    # -- facts about the program ------------------------------------------------------------

    def series_lines(self, order: int) -> int:
        """Return the lines of the recurrences of a Taylor step, unrolled."""
        if order not in self._lines:
            self._lines[order] = self._recurrences.unrolled_lines(order)
        return self._lines[order]

    @property
    def carried(self) -> bool:
        """Whether the slopes at the end of a step are those at the start of the next: where no projection moves it."""
        return not self._program.projects

    @property
    def knots(self) -> Kernel | None:
        """The kernel of the limits of steps at knots of tables, None where there are none."""
        return self._program.kernel("knots") if "knots" in self._program else None

    def control(self, order: int) -> tuple[int, int]:
        """Return the cost of the control of a Taylor step (`dalembert.transforms.taylor.residual_control.cost`)."""
        return cost(self._recurrences, order)

    @property
    def poles(self) -> bool:
        """Whether rates have inverse powers that pairs may step over."""
        return bool(self._recurrences.poles)

    def passes_lost_ranks(self, order: int) -> bool:
        """Return whether constraints may lose rank, and Taylor steps, which pass there, are compiled in seconds."""
        if calls_in(self._program.kernel("rhs")):
            return False
        smooth = not self.nonsmooth and not self.singular_at_rest
        return bool(self._recurrences.pivots) and smooth and self.series_lines(order) <= _LARGEST_REPEATED

    @property
    def nonsmooth(self) -> bool:
        """Whether rates have kinks or jumps in state or time."""
        return self._recurrences.nonsmooth

    @property
    def ends_at_kinks(self) -> bool:
        """Whether Taylor steps end at all kinks and jumps."""
        return self._recurrences.ends_at_kinks

    @once_property
    def singular_at_rest(self) -> bool:
        """Whether Taylor steps cannot leave a state of rest, although rates are finite there."""
        return roots_vanish_at_rest(self._program)

    @once_property
    def angles(self) -> tuple[int, ...]:
        """Components of the state that the motion depends on modulo a turn."""
        return angles_of(self._program)

    # -- texts ------------------------------------------------------------------------------

    @once_property
    def _recurrences(self) -> Recurrences:
        return recurrences(self._program.kernel("rhs"), step_growth_limited=self._program.nonanalytic)

    def _taylor_name(self, order: int, dense: bool, weighted: bool) -> str:
        return f"taylor{order}{'_series' if dense else ''}{_WEIGHTED * weighted}"

    def _taylor_text(self, order: int, lanes: int, dense: bool, weighted: bool) -> str:
        name, known = self._taylor_name(order, dense, weighted), replace(self._recurrences, weighted=weighted)
        return self.step_text(name, known, order, lanes, dense=dense)

    def _program_text(self, name: str, lanes: int) -> str:
        """Return the text of a kernel of the program; that of constants (last argument) takes parameters first."""
        arguments = ("p", "y", "c", "s") if name == "prepare" else STEP_ARGUMENTS
        kernel = replace(self._program.kernel(name), arguments=arguments)
        return self.kernel_text(name, kernel, lanes, exact=name == "prepare")

    def _derivative_kernel(self, name: str) -> tuple[str, Kernel]:
        """Return the name and the kernel of the derivative of a kernel by all of its state."""
        made, derivative = derivative_of(self._program.kernel(name))
        return f"{name}_{made}", derivative

    def _derivative_text(self, name: str, lanes: int) -> str:
        made, kernel = self._derivative_kernel(name)
        return self.kernel_text(made, kernel, lanes)

    def _entry(
        self,
        name: str,
        lanes: int,
        text: Callable[[], str],
        function: str,
        functions: tuple[str, ...] = (),
        table: dict[tuple[str, int], Code] | None = None,
    ) -> OwnedAddress:
        """Return the address of a function of the module `text`, compiled on first use.

        `functions` are all that are called by address, if it is not the only one. The code is kept in a table, that of
        the program itself by default.
        """
        every = functions or (function,)
        loaded = computed_once(
            self._loaded if table is None else table, (name, lanes), lambda: self._load(name, lanes, text, every)
        )
        return loaded.address(function)


_DERIVATIVES = {True: "jacobian", False: "tangent"}


def has_jacobian(kernel: Kernel) -> bool:
    """Return whether the derivative of a kernel by its state is one kernel of the whole Jacobian."""
    return len(kernel.body) * len(kernel.outputs) <= _LARGEST_JACOBIAN


def derivative_of(kernel: Kernel) -> tuple[str, Kernel]:
    """Return the derivative of a kernel by all of its state, and whether it is a "jacobian" or a "tangent"."""
    whole = has_jacobian(kernel)
    derivative = (jacobian_kernel if whole else tangent_kernel)(kernel, len(kernel.outputs), exact=False)
    return _DERIVATIVES[whole], replace(derivative, arguments=STEP_ARGUMENTS)
