"""Python functions as code that compiled loops call."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable

import numpy as np

from ..arrays import FloatArray
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..stops.stops import StopAction
from ..subset.arguments import OwnedAddress

HOST_LANES = 8
"""Lanes of interpreted kernels: eight rows take about as long as one."""

_SIGNATURE = ctypes.CFUNCTYPE(ctypes.c_int64, *(ctypes.c_int64,) * 5)


class _Thread(threading.local):
    """The exception that code of this thread has raised, or None."""

    failure: BaseException | None = None


_THREAD = _Thread()


def host_code(function: Callable[..., int]) -> OwnedAddress:
    """Return a Python function of five addresses as code that loops call.

    What it raises waits for `raise_failure`, because no exception passes through machine code. Until then all such code
    of the thread does nothing, and returns 1.
    """

    def run(*addresses: int) -> int:
        if _THREAD.failure is not None:
            return 1
        try:
            return function(*addresses)
        except BaseException as failure:  # also KeyboardInterrupt
            _THREAD.failure = failure
            return 1

    callback = _SIGNATURE(run)
    return OwnedAddress(ctypes.cast(callback, ctypes.c_void_p).value or 0, callback)


def raise_failure() -> None:
    """Raise what code of this thread has raised since the last call, if anything."""
    failure = _THREAD.failure
    if failure is not None:
        _THREAD.failure = None
        raise failure


def columns_at(address: int, rows: int, lanes: int) -> FloatArray:
    """Return the matrix of doubles (rows, lanes) at an address, a view."""
    if not rows:
        return np.empty((0, lanes))
    return np.ctypeslib.as_array((ctypes.c_double * (rows * lanes)).from_address(address)).reshape(rows, lanes)


def interpreted_code(kernel: Kernel, lanes: int = HOST_LANES) -> OwnedAddress:
    """Return a kernel of (t, y, c) as code for lanes, which interprets it."""
    places = [(load.array, load.index) for load in kernel.loads if load.index is not None]
    sizes = {name: 1 + max((index for array, index in places if array == name), default=-1) for name in "yc"}

    def interpret(t: int, y: int, c: int, s: int, out: int) -> int:
        found = columns_at(out, len(kernel.outputs), lanes)
        states, constants = columns_at(y, sizes["y"], lanes), columns_at(c, sizes["c"], lanes)
        found[:] = interpret_rows(kernel, columns_at(t, 1, lanes)[0], states.T, constants.T).T
        return 0

    return host_code(interpret)


def landing_code(action: StopAction, n_y: int, n_c: int, lanes: int) -> OwnedAddress:
    """Return the Python function of an action at stops as code for lanes; see `dalembert.stops.stops.act`."""
    function, size = action.function, len(action.places)
    assert function is not None

    def land(t: int, y: int, c: int, before: int, out: int) -> int:
        now, states, constants = columns_at(t, 1, lanes)[0], columns_at(y, n_y, lanes), columns_at(c, n_c, lanes)
        earlier, after = columns_at(before, 1 + n_c, lanes), columns_at(out, size, lanes)
        for lane in np.flatnonzero(earlier[0]):
            arguments = states[:, lane].copy(), earlier[1:, lane].copy(), constants[:, lane].copy()
            after[:, lane] = function(float(now[lane]), *arguments)
        return 0

    return host_code(land)
