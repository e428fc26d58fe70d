"""Compiled kernels of events and reductions, for steps of a method."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..integrators.addresses import NO_CODE, AddressTable
from ..integrators.reductions import KINDS
from ..integrators.workspace import POINT_LANES, EventKernels
from ..ir.kernel import Kernel
from ..transforms.step_bounds import StepShape, series_signs_kernel, step_bounds_kernel, step_signs_kernel
from .library import KernelLibrary

if TYPE_CHECKING:
    from ..integrators.event_code import EventCode
    from ..methods.tableau import Tableau

__all__ = ["event_kernels"]


def event_kernels(
    steps: KernelLibrary,
    code: EventCode,
    tableau: Tableau | None,
    sizes: tuple[int, int, int],
    lanes: int,
    with_series: int,
) -> EventKernels:
    """Return compiled kernels of events and reductions.

    Parameters
    ----------
    steps : KernelLibrary
    code : EventCode
    tableau : Tableau or None
        None for Taylor steps.
    sizes : (int, int, int)
        Of the state, the degree of the polynomials of a step, and the memory of a step.
    lanes : int
    with_series : int
        Number of events of which the steps write series: all or none.
    """
    values = code.watch.values
    jumps = [NO_CODE if jump is None else steps.extra_kernel(jump, 1) for jump in code.jumps]
    n, degree, memory = sizes
    step = StepShape(degree, n + with_series, n + with_series + 2 + memory, in_time=tableau is None)
    if with_series:
        signs = series_signs_kernel(with_series, n + with_series, degree)
    else:
        signs = step_signs_kernel(values, step, code.oscillating)
    running = code.running
    return EventKernels(
        step_signs=steps.extra_kernel(signs, lanes),
        values=steps.extra_kernel(values, POINT_LANES),
        value=steps.extra_kernel(values, 1),
        begins=steps.extra_kernel(code.watch.begins, 1),
        start=steps.extra_kernel(code.start.kernel, 1),
        refill=NO_CODE if tableau is None else steps.beginning(tableau, 1),
        given=len(code.start.given),
        checks=2 * len(code.start.labels),
        jumps=AddressTable(jumps),
        directions=np.array([event.direction for event in code.events], np.int64),
        last=np.array([int(event.terminal) for event in code.events], np.int64),
        used=_components(values),
        step_bounds=steps.extra_kernel(step_bounds_kernel(running, step, code.running_oscillates), lanes),
        running=steps.extra_kernel(running, POINT_LANES),
        at=steps.extra_kernel(running, 1),
        kinds=np.array([KINDS.index(kind) for kind in code.kinds], np.int64),
        read=_components(running),
        events_with_series=with_series,
        oscillating=int(code.oscillating),
        running_oscillates=int(code.running_oscillates),
    )


def _components(kernel: Kernel) -> NDArray[np.int64]:
    """Return which components of the state a kernel reads."""
    return np.array(sorted({load.index or 0 for load in kernel.loads if load.array == "y"}), np.int64)
