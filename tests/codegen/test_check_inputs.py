"""The test of what cases are made from, in vector instructions: against the same in plain Python, lane by lane."""

import ctypes

import numpy as np
import pytest

from dalembert.codegen.lane_runs import check_inputs_assembly
from dalembert.codegen.llvm.assembly import compile_object, load_object
from dalembert.codegen.llvm.target import native_lanes

# two plain numbers, then two checks: a magnitude, and what it may be at most
CASES = {
    "sound": (1.0, -2.0, 0.0, 0.0, -1e-9, 1e-8),
    "at its bound": (1e308, 0.0, -3.0, 3.0, 0.0, 1.0),
    "not a number": (np.nan, 1.0, 0.0, 1.0, 0.0, 1.0),
    "infinite": (1.0, -np.inf, 0.0, 1.0, 0.0, 1.0),
    "an infinite bound": (1.0, 1.0, 0.0, 1.0, 0.0, np.inf),
    "a rest that is not a number": (1.0, 1.0, 0.0, 1.0, np.nan, 1.0),
    "a rest too large": (1.0, 1.0, -1.5, 1.0, 0.0, 1.0),
    "a last rest too large": (1.0, 1.0, 0.0, 1.0, 2.0, 1.0),
}


def expected(numbers, plain, checks):
    used = numbers[: plain + checks]
    return bool(np.all(np.isfinite(used)) and np.all(np.abs(used[plain::2]) <= used[plain + 1 :: 2]))


@pytest.mark.parametrize("lanes", sorted({1, 2, native_lanes()}))
def test_lanes_are_judged_as_they_would_be_alone(lanes):
    code = load_object(compile_object(check_inputs_assembly(lanes)))
    function = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, *[ctypes.c_int64] * 4)(code.address("check_inputs"))
    names = list(CASES)
    for first in range(len(names)):
        rows = np.array([CASES[names[(first + lane) % len(names)]] for lane in range(lanes)])
        columns = np.ascontiguousarray(rows.T)
        for plain, checks in ((2, 4), (2, 2), (2, 0), (1, 0), (0, 0)):
            mask = function(columns.ctypes.data, plain, checks, 0, 0)
            assert mask == sum(expected(row, plain, checks) << lane for lane, row in enumerate(rows))
