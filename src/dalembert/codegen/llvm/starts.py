"""Constants and state at the start of single runs, by compiled kernels of one case."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from threading import get_ident

import numpy as np

from ...arrays import FloatArray
from ...integrators.addresses import OwnedAddress
from ...integrators.arguments import address_of
from ..runs import StartCode

__all__ = ["start_code"]

_KERNEL = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 5)
_Memory = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, tuple[int, ...]]


def start_code(prepare: OwnedAddress, start: OwnedAddress, sizes: tuple[int, int, int, int]) -> StartCode:
    """Return the start of runs; every thread that uses it has a memory of its own.

    Parameters
    ----------
    prepare, start : OwnedAddress
        Kernels of constants from parameters, and of the state from given values.
    sizes : (int, int, int, int)
        Number of parameters, constants, given values and outputs.
    """
    constants_of, state_of = prepare.function(_KERNEL), start.function(_KERNEL)

    def memory_of_one() -> _Memory:
        arrays = [np.zeros(size) for size in (1, *sizes)]
        t, p, c, given, out = arrays
        return t, p, c, given, out, tuple(map(address_of, arrays))

    own: dict[int, _Memory] = {}

    def run(time: float, parameters: FloatArray, values: Sequence[float]) -> tuple[FloatArray, FloatArray]:
        held = own.get(get_ident())
        if held is None:
            held = own[get_ident()] = memory_of_one()
        t, p, c, given, out, (at_t, at_p, at_c, at_given, at_out) = held
        t[0], p[:], given[:] = time, parameters, values
        constants_of(at_p, 0, 0, 0, at_c)
        state_of(at_t, at_given, at_c, 0, at_out)
        return c, out

    return run
