"""Steps of integrators as machine code, made when first needed and kept beside the generated module."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import final

from ...ir.kernel import Kernel
from ...ir.program import Program
from ...methods.tableau import Tableau
from ...once import computed_once, once_property
from ...reduction.starting import Start
from ...transforms.partials import jacobian_kernel, tangent_kernel
from ...transforms.periodic import angles_of
from ...transforms.recurrences import Recurrences, recurrences
from ...transforms.residual_control import cost
from ...transforms.taylor import STEP_ARGUMENTS, step_kernel
from .assembly import Compiled, assembly, load_object, native_lanes
from .attempts import attempt_assembly
from .objects import object_code
from .order_loops import LEAST_ORDER, order_loop_assembly
from .series_loops import loop_assembly

__all__ = ["LARGEST_UNROLLED", "StepLibrary"]

_LARGEST_JACOBIAN = 6000
"""Lines of a right-hand side times columns up to which its Jacobian is one kernel: half a second of compilation there,
and some five times faster than column by column (measured on chains of pendulums)."""
LARGEST_UNROLLED = 15_000
"""Lines of the recurrences, written out, up to which Taylor steps are worth their compilation."""
_LARGEST_STRAIGHT = 1000
"""Lines up to which a step is unrolled. Longer code outgrows the cache of instructions: the loop over the orders is up
to twice as fast, and is compiled in a third of the time or less (measured on spheres and sleighs)."""
_LARGEST_PASS = 500
"""Values up to which one pass of the loop over the orders is straight-line code: it takes a second to compile there,
and ever more beyond, and is twice as fast as loops throughout (measured on chains of pendulums)."""


@final
class StepLibrary:
    """Compiled steps of one program.

    Parameters
    ----------
    program : Program
        Whose right-hand side is integrated.
    folder : Path or None
        Where object code is kept; None keeps nothing.
    """

    def __init__(self, program: Program, folder: Path | None) -> None:
        self._program, self._folder = program, folder
        self._lines: dict[int, int] = {}
        self._loaded: dict[tuple[str, int], Compiled] = {}
        self._following: dict[tuple[int, int, int], tuple[Kernel, int]] = {}

    def taylor(self, order: int, lanes: int, *, dense: bool) -> int:
        """Return the address of a Taylor step; with `dense`, one that also writes its series."""
        name = f"taylor{order}{'_series' if dense else ''}"
        return self._entry(name, lanes, lambda: self.taylor_text(name, order, lanes, dense), name)

    def series_lines(self, order: int) -> int:
        """Return the lines of the recurrences of a Taylor step, unrolled."""
        if order not in self._lines:
            self._lines[order] = self._recurrences.unrolled_lines(order)
        return self._lines[order]

    def following(self, joint: Kernel, followed: int, order: int, lanes: int) -> int:
        """Return the address of a Taylor step that writes its series and those of what is followed along it.

        `joint` is a right-hand side with so many further outputs, which are what is followed; the step takes and
        writes them as integrals behind the state.
        """

        def make() -> tuple[Kernel, int]:
            text = _step_text(
                "step", recurrences(joint, followed, paced=self._program.sudden), order, lanes, dense=True
            )
            name = f"following{order}_{hashlib.sha256(text.encode()).hexdigest()[:16]}"
            return joint, self._entry(name, lanes, lambda: text, "step")

        # the kernel is kept, so that no other can have its number
        return computed_once(self._following, (id(joint), order, lanes), make)[1]

    def taylor_text(self, name: str, order: int, lanes: int, dense: bool) -> str:
        """Return a Taylor step: unrolled where it is short, else with loops, and the longest with few lines besides."""
        return _step_text(name, self._recurrences, order, lanes, dense=dense)

    def attempt(self, tableau: Tableau, lanes: int, *, dense: bool) -> tuple[int, int]:
        """Return the addresses of one attempt of a Runge-Kutta step, and of what precedes the first."""
        rhs, carried = self._program.kernel("rhs"), self.carried

        def text() -> str:
            return attempt_assembly(rhs, tableau, lanes, dense=dense, carried=carried)

        name = f"{tableau.name}{'_dense' if dense else ''}"
        return self._entry(name, lanes, text, "attempt"), self._entry(name, lanes, text, "start")

    def beginning(self, tableau: Tableau, lanes: int) -> int:
        """Return the address of what precedes the first attempt."""
        return self.attempt(tableau, lanes, dense=False)[1]

    @property
    def carried(self) -> bool:
        """Whether the slopes at the end of a step are those at the start of the next: where no projection moves it."""
        return "project_position" not in self._program and "project_velocity" not in self._program

    def source(self, method: str, order: int) -> str:
        """Return the assembly that single runs by a method take, module after module; `order` is that of "taylor"."""
        kernels = ["prepare", "project_position", "project_velocity"]
        texts = []
        if method == "taylor":
            name = f"taylor{order}_series"
            texts.append(self.taylor_text(name, order, 1, dense=True))
        elif method == "radau":
            rates = "stages" if "stages" in self._program else "rhs"
            kernels.insert(1, rates)
            texts.append(self._derivative_text(rates))
        else:
            kernels.insert(1, "rhs")
        return "\n\n".join([*(self._kernel_text(name, 1) for name in kernels if name in self._program), *texts])

    def kernel(self, name: str, lanes: int = 1) -> int:
        """Return the address of a kernel of the program as it stands, 0 where it has none."""
        if name not in self._program:
            return 0
        return self._entry(name, lanes, lambda: self._kernel_text(name, lanes), name)

    def prepare(self, lanes: int = 1) -> int:
        """Return the address of the kernel that computes constants (last argument) from parameters (first)."""
        return self.kernel("prepare", lanes)

    def start(self, start: Start, lanes: int) -> int:
        """Return the address of the kernel that makes states, with their checks, from given values."""
        name = f"start_{hashlib.sha256(' '.join(start.given).encode()).hexdigest()[:16]}"
        kernel = replace(start.kernel, arguments=STEP_ARGUMENTS)
        return self._entry(name, lanes, lambda: assembly([("start", kernel)], lanes, exact=True), "start")

    def further(self, kernel: Kernel, lanes: int) -> int:
        """Return the address of a kernel of (t, y, c) that is not the program's own."""
        text = assembly([(kernel.name, replace(kernel, arguments=STEP_ARGUMENTS))], lanes)
        name = f"{kernel.name}_{hashlib.sha256(text.encode()).hexdigest()[:16]}"
        return self._entry(name, lanes, lambda: text, kernel.name)

    def derivative(self, name: str) -> tuple[int, int]:
        """Return the addresses of the derivative of a kernel by all of its state.

        The first is the whole Jacobian, the second one column after the other (see `dalembert.transforms.partials`);
        one of them is 0.
        """
        made, whole = self._derivative(name)
        address = self._entry(made, 1, lambda: self._derivative_text(name), made)
        return (address, 0) if whole else (0, address)

    def _derivative(self, name: str) -> tuple[str, bool]:
        """Return the name of the derivative of a kernel, and whether it is the whole Jacobian."""
        kernel = self._program.kernel(name)
        whole = len(kernel.body) * len(kernel.outputs) <= _LARGEST_JACOBIAN
        return f"{name}_{'jacobian' if whole else 'tangent'}", whole

    def control(self, order: int) -> tuple[int, int]:
        """Return the cost of the control of a Taylor step (`dalembert.transforms.residual_control.cost`)."""
        return cost(self._recurrences, order)

    @property
    def poles(self) -> bool:
        """Whether rates have inverse powers that pairs may step over."""
        return bool(self._recurrences.poles)

    @property
    def kinked(self) -> bool:
        """Whether rates have kinks or jumps in state or time."""
        return self._recurrences.kinked

    @once_property
    def angles(self) -> tuple[int, ...]:
        """Components of the state that the motion depends on modulo a turn."""
        return angles_of(self._program)

    @once_property
    def _recurrences(self) -> Recurrences:
        return recurrences(self._program.kernel("rhs"), paced=self._program.sudden)

    def _kernel_text(self, name: str, lanes: int) -> str:
        """Return a kernel of the program as it stands; that of constants (last argument) takes parameters first."""
        arguments = ("p", "y", "c", "s") if name == "prepare" else STEP_ARGUMENTS
        kernel = replace(self._program.kernel(name), arguments=arguments)
        return assembly([(name, kernel)], lanes, exact=name == "prepare")

    def _derivative_text(self, name: str) -> str:
        """Return the derivative of a kernel by all of its state."""
        kernel, (made, whole) = self._program.kernel(name), self._derivative(name)
        derivative = (jacobian_kernel if whole else tangent_kernel)(kernel, len(kernel.outputs))
        return assembly([(made, replace(derivative, arguments=STEP_ARGUMENTS))], 1)

    def _entry(self, name: str, lanes: int, text: Callable[[], str], function: str) -> int:
        """Return the address of a function of the module `text`, compiled when first asked for."""
        loaded = computed_once(
            self._loaded, (name, lanes), lambda: load_object(object_code(self._folder, f"{name}_{lanes}", text))
        )
        return loaded.address(function)


def _step_text(name: str, known: Recurrences, order: int, lanes: int, *, dense: bool) -> str:
    lines = known.unrolled_lines(order)
    if lines <= _LARGEST_STRAIGHT or order < LEAST_ORDER:
        return assembly([(name, step_kernel(known, order, dense=dense))], lanes)
    if len(known.items) <= _LARGEST_PASS:
        return order_loop_assembly(name, known, order, lanes, native_lanes(), dense=dense)
    return loop_assembly(name, known, order, lanes, dense=dense)
