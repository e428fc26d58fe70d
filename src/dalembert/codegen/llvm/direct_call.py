"""Calls of prepared runs from Python without `ctypes`, in half of the time."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from typing import Any, NamedTuple, final

import llvmlite.binding as llvm
import numpy as np

from ...arrays import FloatArray
from ...methods.status import Status
from ...once import once
from ...subset.packing import address_of
from ..rendering import render
from .assembly import LoadedCode
from .loops import library_code

_CALLED = (
    *("PyCapsule_GetPointer", "PyObject_GetBuffer", "PyBuffer_Release", "PyEval_SaveThread", "PyEval_RestoreThread"),
    *("PyObject_CallNoArgs", "PyErr_Clear", "Py_IncRef"),
)
"""Functions of Python's stable interface that the code calls."""

_CONTIGUOUS, _FORMAT, _FAST_CALL = 0x38, 0x4, 0x80
"""``PyBUF_C_CONTIGUOUS``, ``PyBUF_FORMAT`` and ``METH_FASTCALL`` of that interface."""

_DOUBLES = ord("d")
"""The format of an array of doubles: a letter and a zero."""

_BUSY = 8
"""Place in the memory of a function that says whether a run is under way."""


def direct_call_assembly() -> str:
    """Return a module that defines ``direct_call``, which `DirectCall` makes a function of Python."""
    variables = {
        "contiguous_with_format": _CONTIGUOUS | _FORMAT,
        "doubles": _DOUBLES,
        "success": int(Status.SUCCESS),
    }
    return render("llvm/direct_call.ll.j2", variables)


def can_call_directly() -> bool:
    """Whether this Python is CPython with its global lock, under which the function looks at its memory."""
    locked: Callable[[], bool] = getattr(sys, "_is_gil_enabled", lambda: True)
    return sys.implementation.name == "cpython" and locked()


class _Method(ctypes.Structure):
    """``PyMethodDef`` of Python's interface."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("text", ctypes.c_char_p),
    )


class _Interface(NamedTuple):
    """Functions of Python's interface that make a function, and what every function made so calls."""

    capsule: Callable[[int, None, None], Any]
    function: Callable[[int, Any, object], Callable[[Any, Any], FloatArray | None]]
    code: LoadedCode
    method: _Method


@once
def _interface() -> _Interface:
    api = ctypes.pythonapi
    for name in _CALLED:
        llvm.add_symbol(name, ctypes.cast(getattr(api, name), ctypes.c_void_p).value)
    code = library_code("direct_call", direct_call_assembly)
    address, owned = ctypes.c_void_p, ctypes.py_object
    capsule = ctypes.PYFUNCTYPE(owned, address, address, address)(("PyCapsule_New", api))
    function = ctypes.PYFUNCTYPE(owned, address, owned, owned)(("PyCFunction_NewEx", api))
    return _Interface(capsule, function, code, _Method(b"run", code.address("direct_call"), _FAST_CALL, None))


@final
class DirectCall:
    """A run as a function of Python.

    Parameters
    ----------
    loop, arguments : int
        Addresses of the loop and of its arguments. It returns a status, or a negative number where it pauses.
    start, parameters : ndarray
        Where the loop reads them. It leaves the final state in the place of the start.
    held : object
        What must live as long as the loop runs.

    Attributes
    ----------
    run : function
        Of the state and the parameters, one-dimensional arrays of doubles: returns the final state. None where it did
        not run or did not end with SUCCESS. Only one thread at a time runs; the others get None at once.
    """

    def __init__(self, loop: int, arguments: int, start: FloatArray, parameters: FloatArray, held: object) -> None:
        made, copy = _interface(), start.copy
        addresses = address_of(start), start.nbytes, address_of(parameters), parameters.nbytes
        self._memory = np.array([loop, arguments, *addresses, id(copy), id(None), 0], np.int64)
        capsule = made.capsule(address_of(self._memory), None, None)
        lives_as_long = self._memory, copy, parameters, made, held  # in the place of the module of the function
        self.run = made.function(ctypes.addressof(made.method), capsule, lives_as_long)

    def end(self) -> None:
        """Let the function return None from now on: its runs pause, and the call is a small part of their time."""
        self._memory[_BUSY] = 1
