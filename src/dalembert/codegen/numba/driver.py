"""A whole run as one function of machine code, for prepared runs.

This is the loop of `dalembert.integrators.numba.march` without recording and projection, written in LLVM
assembly beside the step that it calls: a call of a function compiled by numba costs more than it takes to
simulate some scenes.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np

from ...integrators.problem import FloatArray, IntegrationProblem
from ...integrators.status import Status

__all__ = ["DRIVER", "call_driver"]

DRIVER = """
define void @run(ptr %frame) nounwind {{
entry:
  %t0 = load double, ptr %frame
  %t1.at = getelementptr double, ptr %frame, i64 1
  %t1 = load double, ptr %t1.at
  %largest.at = getelementptr double, ptr %frame, i64 2
  %largest = load double, ptr %largest.at
  %budget.at = getelementptr i64, ptr %frame, i64 3
  %budget = load i64, ptr %budget.at
  %status.at = getelementptr i64, ptr %frame, i64 4
  %settings = getelementptr double, ptr %frame, i64 5
  %direction.at = getelementptr double, ptr %frame, i64 6
  %direction = load double, ptr %direction.at
  %clock = getelementptr double, ptr %frame, i64 8
  %state = getelementptr double, ptr %frame, i64 {state}
  %p = getelementptr double, ptr %frame, i64 {parameters}
  %c = getelementptr double, ptr %frame, i64 {constants}
  %a = getelementptr double, ptr %frame, i64 {first}
  %b = getelementptr double, ptr %frame, i64 {second}
  call void @prepare(ptr %p, ptr %c)
  br label %loop
loop:
  %t = phi double [%t0, %entry], [%t.next, %next]
  %y = phi ptr [%state, %entry], [%new, %next]
  %new = phi ptr [%a, %entry], [%other, %next]
  %other = phi ptr [%b, %entry], [%new, %next]
  %k = phi i64 [0, %entry], [%k.next, %next]
  %gap = fsub double %t1, %t
  %rest = call double @llvm.fabs.f64(double %gap)
  %ended = fcmp oeq double %rest, 0.0
  br i1 %ended, label %done, label %more
more:
  %spent = icmp eq i64 %k, %budget
  br i1 %spent, label %done, label %step
step:
  %short = fcmp olt double %rest, %largest
  %allowed = select i1 %short, double %rest, double %largest
  store double %allowed, ptr %settings
  store double %t, ptr %clock
  call void @{step}(ptr %clock, ptr %y, ptr %c, ptr %settings, ptr %new)
  %size.at = getelementptr double, ptr %new, i64 {size}
  %size = load double, ptr %size.at
  %check.at = getelementptr double, ptr %new, i64 {check}
  %check = load double, ptr %check.at
  %infinite = fcmp une double %check, 0.0
  br i1 %infinite, label %done, label %finite
finite:
  %last = fcmp oeq double %size, %rest
  %magnitude = call double @llvm.fabs.f64(double %t)
  %smallest = fmul double %magnitude, {spacing}
  %tiny = fcmp ole double %size, %smallest
  %inside = xor i1 %last, true
  %stuck = and i1 %tiny, %inside
  br i1 %stuck, label %done, label %next
next:
  %signed = fmul double %size, %direction
  %sum = fadd double %t, %signed
  %t.next = select i1 %last, double %t1, double %sum
  %k.next = add i64 %k, 1
  br label %loop
done:
  %status = phi i64 [{success}, %loop], [{max_steps}, %more], [{non_finite}, %step], [{too_small}, %finite]
  %odd = and i64 %k, 1
  %some = icmp ne i64 %k, 0
  %flag = zext i1 %some to i64
  %twice = shl i64 %flag, 1
  %which = sub i64 %twice, %odd
  store i64 %status, ptr %status.at
  %which.at = getelementptr i64, ptr %frame, i64 9
  store i64 %which, ptr %which.at
  ret void
}}
"""
"""The state lies in the frame, two rows for results behind it; word 9 says which of the three holds the last state."""

_HEADER = 10
_SPACING = 16.0 * 2.220446049250313e-16


def offsets(n: int, n_p: int, n_c: int) -> dict[str, int]:
    """Return where the arrays lie in the frame, in doubles."""
    state = _HEADER
    parameters = state + n
    constants = parameters + n_p
    first = constants + n_c
    return {
        "state": state,
        "parameters": parameters,
        "constants": constants,
        "first": first,
        "second": first + n + 2,
        "size": n,
        "check": n + 1,
    }


def driver_text(step: str, n: int, n_p: int, n_c: int) -> str:
    """Return the assembly of a run that calls the functions ``prepare`` and `step` of the same module."""
    return DRIVER.format(
        step=step,
        spacing=f"0x{np.float64(_SPACING).view(np.uint64):016X}",
        success=int(Status.SUCCESS),
        max_steps=int(Status.MAX_STEPS),
        non_finite=int(Status.NON_FINITE),
        too_small=int(Status.STEP_TOO_SMALL),
        **offsets(n, n_p, n_c),
    )


def call_driver(
    address: int, sizes: tuple[int, int, int], problem: IntegrationProblem, floor: float
) -> Callable[[FloatArray, FloatArray], tuple[FloatArray, Status]]:
    """Return a function from a state (n_y,) and parameters (n_p,) to the final state (n_y,) and the status.

    Parameters
    ----------
    address : int
        Address of the compiled run.
    sizes : (int, int, int)
        Number of components of the state, of parameters and of constants.
    problem : IntegrationProblem
        Span, largest step and number of steps.
    floor : float
        Size below which a state counts as that large.
    """
    n, n_p, n_c = sizes
    place = offsets(n, n_p, n_c)
    frame = np.zeros(place["second"] + n + 2)
    words = frame.view(np.int64)
    frame[:3] = problem.t0, problem.t1, problem.max_step
    words[3] = problem.max_steps
    frame[6:8] = (1.0 if problem.t1 >= problem.t0 else -1.0), floor
    state = frame[place["state"] : place["state"] + n]
    parameters = frame[place["parameters"] : place["parameters"] + n_p]
    ends = state, *(frame[place[row] : place[row] + n] for row in ("first", "second"))
    code = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(address)
    pointer = ctypes.c_void_p(frame.ctypes.data)
    outcome = words[4:10:5]
    statuses = tuple(Status)

    def run(given: FloatArray, p: FloatArray) -> tuple[FloatArray, Status]:
        state[:] = given
        parameters[:] = p
        code(pointer)
        status, which = outcome.tolist()
        return ends[which].copy(), statuses[status]

    return run
