"""Tests of the states and parameters that prepared runs are given, by compiled kernels of one case."""

from __future__ import annotations

import ctypes
import hashlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import get_ident
from typing import cast, final

import numpy as np

from ...arrays import FloatArray
from ...ir.kernel import Kernel
from ...loops.prepared_loop import admission_status
from ...methods.status import RUNNING, Status
from ...once import once_property
from ...reduction.start_limits import TOLERANCE
from ...subset.addresses import OwnedAddress
from ...subset.arguments import address_of
from ...transforms.taylor import STEP_ARGUMENTS
from ..runs import Final
from .assembly import LoadedCode, assembly, load_object, object_code
from .lane_printer import with_tables

_DRIFT = 1e-4
"""Relative residual that runs may leave which do not project their states."""

_KERNEL = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 5)
_Memory = tuple[FloatArray, FloatArray, FloatArray, FloatArray, tuple[int, ...]]


@final
class AdmissionCode:
    """Test of what prepared runs are given as machine code, compiled on first use.

    Parameters
    ----------
    kernel : Kernel
        Of `dalembert.reduction.admission`.
    sizes : (int, int)
        Number of components of the state, and of parameters.
    folder : Path or None
        Where the code is kept; None keeps nothing.
    projected : bool
        Whether runs project their states onto the constraints; those of others drift, and may start anew.

    Attributes
    ----------
    count : int
        Number of outputs of the kernel.
    slack : float
        By how many times a start may exceed the residuals of constraints that given initial values may have.
    """

    def __init__(self, kernel: Kernel, sizes: tuple[int, int], folder: Path | None, *, projected: bool = True) -> None:
        self._kernel, self._folder = replace(kernel, arguments=STEP_ARGUMENTS), folder
        self.sizes, self.count, self.slack = sizes, len(kernel.outputs), 1.0 if projected else _DRIFT / TOLERANCE

    @once_property
    def _loaded(self) -> LoadedCode:
        name = f"admission_{hashlib.sha256(repr(self._kernel).encode()).hexdigest()[:16]}"
        text = [("admission", self._kernel)]
        return load_object(object_code(self._folder, name, lambda: with_tables(assembly(text, 1))))

    @property
    def address(self) -> OwnedAddress:
        """Address of the kernel of (t, y, c)."""
        return self._loaded.address("admission")

    @once_property
    def call(self) -> Callable[..., None]:
        """The kernel as a function of addresses."""
        return cast("Callable[..., None]", self.address.function(_KERNEL))


@final
class Admission:
    """Test of what the runs from one time are given; threads may share it.

    Parameters
    ----------
    code : AdmissionCode
    time : float
        Start of the runs [s].
    rtol : float
        Tolerance of the runs: a start may be as far from the constraints as a run before leaves it.

    Attributes
    ----------
    slack : float
        By how many times a start may exceed the residuals of constraints that given initial values may have.

    Other Parameters
    ----------------
    otherwise : function from a state and parameters to a final state and a status, or to None; optional
        Another way to run what the constraints refuse, None where they refuse that, too.
    """

    def __init__(
        self,
        code: AdmissionCode,
        time: float,
        rtol: float,
        otherwise: Callable[[FloatArray, FloatArray], Final | None] | None = None,
    ) -> None:
        self.code, self._time, self.slack = code, time, max(code.slack, rtol / TOLERANCE)
        self._otherwise = otherwise
        self._own: dict[int, _Memory] = {}

    def _memory(self) -> _Memory:
        arrays = (np.zeros(1), *map(np.zeros, self.code.sizes), np.zeros((self.code.count, 1)))
        t, y, p, tests = arrays
        return t, y, p, tests, tuple(map(address_of, arrays))

    def __call__(self, state: FloatArray, parameters: FloatArray) -> Status:
        """Return the status of a run that may not start from a state (n_y,) and parameters (n_p,), else SUCCESS."""
        held = self._own.get(get_ident())
        if held is None:
            held = self._own[get_ident()] = self._memory()
        t, y, p, tests, (at_t, at_y, at_p, at_tests) = held
        t[0], y[:], p[:] = self._time, state, parameters
        self.code.call(at_t, at_y, at_p, 0, at_tests)
        status = admission_status(tests, self.slack)
        return Status.SUCCESS if status == RUNNING else Status(status)

    def final_of_refused(self, status: Status, state: FloatArray, parameters: FloatArray) -> Final:
        """Return the final state (n_y,) and the status of a run that this test refuses."""
        if status is Status.INITIAL_STATE and self._otherwise is not None:
            final = self._otherwise(state, parameters)
            if final is not None:
                return final
        return np.full(state.shape, np.nan), status
