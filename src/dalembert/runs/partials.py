"""Values of the kernels of a program and their exact derivatives by state and parameters."""

from __future__ import annotations

from dataclasses import replace
from typing import final

import numpy as np

from ..arrays import FloatArray
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..ir.program import Program
from ..once import derived_once
from ..transforms.partials import tangent_kernel


@final
class Partials:
    """Kernels of a program with the kernels of their derivatives, which are derived once.

    Parameters
    ----------
    program : Program

    Notes
    -----
    A kernel that the program does not have has no outputs. Times t are numbers, states y have shape (n_y,), and
    constants c (n_c,) begin with the parameters.
    """

    def __init__(self, program: Program) -> None:
        self._program = program
        self._derived: dict[tuple[str, str], Kernel] = {}

    def value(self, name: str, t: float, y: FloatArray, c: FloatArray) -> FloatArray:
        """Return the outputs (k,) of a kernel."""
        return self._run(self._program.kernel(name), t, y, c) if name in self._program else np.zeros(0)

    def by_state(self, name: str, t: float, y: FloatArray, c: FloatArray) -> FloatArray:
        """Return the derivatives (k, n_y) of the outputs of a kernel by its array y."""
        if name not in self._program:
            return np.zeros((0, len(y)))
        return self._along(self._kernel(name, "y", len(y), len(y)), t, y, np.eye(len(y)), c)

    def by_parameters(self, name: str, t: float, y: FloatArray, c: FloatArray) -> FloatArray:
        """Return the derivatives (k, n_p) of the outputs of a kernel by the parameters, through its constants."""
        count = len(self._program.layout.parameters)
        if name not in self._program:
            return np.zeros((0, count))
        none = np.zeros(count)
        c_by_p = self._along(self._kernel("prepare", "p", count, count), t, none, np.eye(count), c)
        return self._along(self._kernel(name, "c", len(y), len(c)), t, y, c_by_p.T, c)

    @staticmethod
    def _run(kernel: Kernel, t: float, y: FloatArray, c: FloatArray) -> FloatArray:
        with np.errstate(all="ignore"):
            return interpret_rows(kernel, np.array([t]), y[np.newaxis], c)[0]

    @staticmethod
    def _along(kernel: Kernel, t: float, y: FloatArray, directions: FloatArray, c: FloatArray) -> FloatArray:
        """Return the derivatives (k, n) of a kernel along directions (n, ...), one a row."""
        rows = np.hstack([np.tile(y, (len(directions), 1)), directions])
        with np.errstate(all="ignore"):
            return interpret_rows(kernel, np.full(len(rows), t), rows, c).T

    def _kernel(self, name: str, array: str, size: int, count: int) -> Kernel:
        return derived_once(self._derived, (name, array), lambda: self._differentiated(name, array, size, count))

    def _differentiated(self, name: str, array: str, size: int, count: int) -> Kernel:
        """Return the kernel of the derivative along one direction, which stands behind y."""
        kernel = self._program.kernel(name)
        if array == "p":  # the constants begin with the parameters
            loads = tuple(replace(load, array="c") for load in kernel.loads)
            kernel, array = replace(kernel, arguments=("t", "y", "c"), loads=loads), "c"
        return tangent_kernel(kernel, size, array, count)
