"""Prepared runs, starts of single runs, and tests of what they are given: a call of machine code for one case."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from threading import get_ident
from time import perf_counter
from typing import cast, final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...ir.kernel import Kernel
from ...loops.prepared_loop import (
    PreparedArguments,
    PreparedKernels,
    PreparedLimits,
    PreparedProgress,
    admission_status,
)
from ...methods.status import RUNNING, Status
from ...once import once_property
from ...reduction.start_limits import TOLERANCE
from ...steps.problem import IntegrationProblem
from ...stops.stops import no_stops
from ...subset.arguments import OwnedAddress, place_of
from ...subset.packing import address_of, pack
from ...threads import check
from ...transforms.taylor.step import STEP_ARGUMENTS
from ..host_code import raise_failure
from ..runs import Final, StartCode
from .assembly import LoadedCode, assembly, load_object, object_code
from .definitions import with_definitions
from .direct_call import DirectCall, can_call_directly
from .loops import loop_named

_DRIFT = 1e-4
"""Relative residual that runs may leave which do not project their states."""

_KERNEL = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 5)
_Rows = tuple[FloatArray, FloatArray, FloatArray, FloatArray, tuple[int, ...]]


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
        name = f"admission_{self._kernel.digest}"
        text = [("admission", self._kernel)]
        return load_object(object_code(self._folder, name, lambda: with_definitions(assembly(text, 1))))

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
        Another way to run what the constraints reject, None where they reject that as well.
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
        self._own: dict[int, _Rows] = {}

    def _memory(self) -> _Rows:
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
        """Return the final state (n_y,) and the status of a run that this test rejects."""
        if status is Status.INITIAL_STATE and self._otherwise is not None:
            final = self._otherwise(state, parameters)
            if final is not None:
                return final
        return np.full(state.shape, np.nan), status


_PATIENCE_AT = place_of(PreparedArguments, "limits.patience")
_PATIENCE, _MOST_PATIENCE, _QUICK = 1000, 1 << 24, 0.02
"""Attempts after which a run first returns to Python, and at most; seconds below which the next may take longer."""

_Memory = tuple[FloatArray, FloatArray, ctypes.c_void_p, NDArray[np.int64], object]
"""Start and final state (n_y,), parameters (n_p,), the address of the arguments, the arguments of a run that continues,
and the owner of the memory."""


def _finished(code: Callable[[ctypes.c_void_p], int], going: NDArray[np.int64]) -> int:
    """Take a run that has paused to its end and return its status; Ctrl-C is raised between its parts."""
    packed_args, patience, status = going.copy(), _PATIENCE, -1  # an interrupted run leaves nothing behind
    pointer = ctypes.c_void_p(address_of(packed_args))
    while status < 0:
        begin = perf_counter()
        packed_args[_PATIENCE_AT] = patience
        status = code(pointer)
        raise_failure()
        check()
        if perf_counter() - begin < _QUICK:
            patience = min(2 * patience, _MOST_PATIENCE)
    return status


def _memory(
    kernels: PreparedKernels,
    sizes: tuple[int, int, int],
    memory: int,
    settings: Sequence[float],
    problem: IntegrationProblem,
    tests: tuple[int, float],
) -> _Memory:
    """Return the memory of a thread; for the arguments see `prepared_run`.

    `tests` are the number of outputs and the slack of the tests of what the run is given.
    """
    (n_tests, slack), (n, n_p, n_c) = tests, sizes
    states, p = np.zeros((2, n + 2 + memory)), np.zeros((1, n_p))
    span = float(problem.t0), float(problem.t1), float(problem.max_step)
    inputs = None if problem.inputs is None else problem.inputs.table(1, n + 2 + memory)
    arguments = PreparedArguments(
        kernels=kernels,
        limits=PreparedLimits(*span, problem.max_steps, _PATIENCE, going=False, slack=slack),
        n=n,
        memory=memory,
        parameters=p,
        constants=np.zeros((n_c, 1)),
        settings=np.array([[0.0, 1.0 if problem.t1 >= problem.t0 else -1.0, *settings]]),
        clock=np.zeros((1, 1)),
        states=states,
        times=np.zeros(0),
        low=np.zeros(0),
        delta=np.zeros((n, 1)),
        mark=np.zeros(1, np.int64),
        tests=np.zeros((n_tests, 1)),
        progress=PreparedProgress(),
        stops=no_stops(inputs) if inputs is None or problem.stops is None else problem.stops.table(inputs, 1, n_c),
    )
    begun = pack(arguments)
    going = pack(arguments._replace(limits=arguments.limits._replace(going=True)))
    return states[0, :n], p[0], ctypes.c_void_p(address_of(begun)), going, (begun, arguments)


@final
class CompiledRun:
    """A prepared run by machine code; every thread that uses it has a memory of its own (see `Prepared`).

    Attributes
    ----------
    direct : function of a state and parameters, or None
        The same run as one call of machine code (`DirectCall`). Its caller removes the thread from `ended`.
    ended : dict
        Statuses of the last calls of this object, by thread.
    """

    def __init__(self, own_memory: Callable[[], _Memory], admission: Admission | None, *, calls: bool) -> None:
        self._own_memory, self._admission, self._calls = own_memory, admission, calls
        self._own, loop = {get_ident(): own_memory()}, loop_named("prepared_loop")
        self._code, self.ended = loop.call, dict[int, int]()
        self._direct: DirectCall | None = None
        if can_call_directly() and not calls and not loop.plain:
            start, given, pointer, *held = own_memory()
            self._direct = DirectCall(loop.entry, pointer.value or 0, start, given, held)
        self.direct = self._direct and self._direct.run

    def __call__(self, state: FloatArray, parameters: FloatArray, /) -> FloatArray:
        """See `Prepared`."""
        thread = get_ident()
        if thread not in self._own:
            self._own[thread] = self._own_memory()
        start, given, pointer, going, _ = self._own[thread]
        start[...] = state
        given[...] = parameters
        self.ended[thread] = status = self._code(pointer)
        if self._calls:
            raise_failure()
        if status < 0:
            if self._direct is not None:
                self._direct.end()
            self.ended[thread] = _finished(self._code, going)
        elif status == Status.INITIAL_STATE and self._admission is not None:
            final, self.ended[thread] = self._admission.final_of_refused(Status.INITIAL_STATE, state, parameters)
            return final
        return start.copy()

    def status(self) -> Status:
        """See `Prepared`."""
        last = self.ended.get(get_ident(), Status.SUCCESS)
        return Status.INTERRUPTED if last < 0 else Status(last)


def prepared_run(
    kernels: PreparedKernels,
    sizes: tuple[int, int, int],
    memory: int,
    settings: Sequence[float],
    problem: IntegrationProblem,
    admission: Admission | None = None,
) -> CompiledRun:
    """Return a prepared run; every thread that uses it has a memory of its own.

    Parameters
    ----------
    kernels : PreparedKernels
    sizes : (int, int, int)
        Number of components of the state, of parameters and of constants.
    memory : int
        How many numbers a step remembers; 0 for one that cannot be rejected.
    settings : sequence of float
        Settings of the step after the largest step and the direction of time.
    problem : IntegrationProblem
        Span, largest step, number of steps, records of inputs, and stops.
    admission : Admission, optional
        Test of what the run is given, whose kernel is among `kernels`.
    """
    tests = (0, 1.0) if admission is None else (admission.code.count, admission.slack)
    calls = problem.stops is not None and problem.stops.calls

    def own_memory() -> _Memory:
        return _memory(kernels, sizes, memory, settings, problem, tests)

    return CompiledRun(own_memory, admission, calls=calls)


# Constants and state at the start of single runs, by compiled kernels of one case.

_StartMemory = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, tuple[int, ...]]


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

    def memory_of_one() -> _StartMemory:
        arrays = [np.zeros(size) for size in (1, *sizes)]
        t, p, c, given, out = arrays
        return t, p, c, given, out, tuple(map(address_of, arrays))

    own: dict[int, _StartMemory] = {}

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
