"""Compiled kernels of events and reductions, for steps of a method."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..events.reductions import KINDS
from ..ir.kernel import Kernel
from ..lanes.workspace import POINT_LANES, EventKernels
from ..subset.addresses import NO_CODE, AddressTable, OwnedAddress
from ..transforms.step_bounds import StepShape, series_signs_kernel, step_bounds_kernel, step_signs_kernel

if TYPE_CHECKING:
    from ..events.event_code import EventCode


def event_kernels(
    compiled: Callable[[Kernel, int], OwnedAddress],
    projections: tuple[OwnedAddress, OwnedAddress],
    code: EventCode,
    refill: OwnedAddress,
    sizes: tuple[int, int, int],
    lanes: int,
    with_series: int,
    *,
    tested: bool,
    exact: bool,
) -> EventKernels:
    """Return compiled kernels of events and reductions.

    Parameters
    ----------
    compiled : function
        Compiles a kernel for lanes.
    projections : (OwnedAddress, OwnedAddress)
        Corrections of positions and of velocities, for one lane.
    code : EventCode
    refill : OwnedAddress
        What a step remembers at its start; `NO_CODE` for Taylor steps.
    sizes : (int, int, int)
        Of the state, the degree of the polynomials of a step, and the memory of a step.
    lanes : int
    with_series : int
        Number of events of which the steps write series: all or none.
    tested : bool
        Whether there is a test of whole steps; else all steps are searched.
    exact : bool
        Whether polynomials of steps have no error that counts.
    """
    values = code.watch.values
    jumps = [NO_CODE if jump is None else compiled(jump, 1) for jump in code.jumps]
    n, degree, memory = sizes
    step = StepShape(degree, n + with_series, n + with_series + 2 + memory, in_time=refill == 0)
    signs, running, bounds = NO_CODE, code.running, NO_CODE
    if tested and with_series:
        signs = compiled(series_signs_kernel(with_series, n + with_series, degree), lanes)
    elif tested:
        signs = compiled(step_signs_kernel(values, step, code.oscillating), lanes)
    if code.kinds:
        bounds = compiled(step_bounds_kernel(running, step, code.running_oscillates), lanes)
    return EventKernels(
        step_signs=signs,
        values=compiled(values, POINT_LANES),
        value=compiled(values, 1),
        begins=compiled(code.watch.begins, 1),
        start=compiled(code.start.kernel, 1) if any(jump is not None for jump in code.jumps) else NO_CODE,
        refill=refill,
        given=len(code.start.given),
        checks=2 * len(code.start.labels),
        jumps=AddressTable(jumps),
        directions=np.array([event.direction for event in code.events], np.int64),
        last=np.array([int(event.terminal) for event in code.events], np.int64),
        used=_components(values),
        step_bounds=bounds,
        running=compiled(running, POINT_LANES) if code.kinds else NO_CODE,
        at=compiled(running, 1) if code.kinds else NO_CODE,
        kinds=np.array([KINDS.index(kind) for kind in code.kinds], np.int64),
        read=_components(running),
        events_with_series=with_series,
        oscillating=int(code.oscillating),
        running_oscillates=int(code.running_oscillates),
        position=projections[0],
        velocity=projections[1],
        exact=int(exact),
    )


def _components(kernel: Kernel) -> NDArray[np.int64]:
    """Return which components of the state a kernel reads."""
    return np.array(sorted({load.index or 0 for load in kernel.loads if load.array == "y"}), np.int64)
