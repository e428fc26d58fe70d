"""Loops translated from Python: what they compute is what Python computes, and what has no translation is named."""

import ctypes
import math

import numpy as np
import pytest

from dalembert.codegen.llvm.assembly import compile_object, load_object
from dalembert.codegen.llvm.loops import packed
from dalembert.codegen.subset import loop_assembly
from dalembert.integrators import explicit_loop as explicit
from dalembert.integrators import implicit_loop as implicit
from dalembert.integrators import lane_loop as lanes
from dalembert.integrators import prepared_loop as single
from dalembert.integrators import sample_projection as samples
from dalembert.integrators import taylor_loop as march
from dalembert.integrators.compiled_subset import ahead, bare, element, flat, lowest, row, take
from dalembert.integrators.kinds import ARRAY_OF_FLAGS, INTEGER, INTEGERS, MATRIX, VECTOR, Group

TABLE = np.array([[1.5, -2.0], [0.25, 8.0]])
WANTED = True


@bare
def split(x: float, k: int) -> tuple[float, int]:
    if x < 0.0:
        return -x, k - 1
    return x, k + 1


@bare
def fill(out, x: float) -> None:
    for i in range(out.size):
        if i == 3:
            return
        out[i] += x


@bare
def numbers(a, b):
    """Whole numbers."""
    return a


@bare
def arithmetic(given: tuple[int, int], x, out, whole) -> int:
    a, b = given
    whole[0], whole[1], whole[2], whole[3] = a // b, a % b, a << 2, (a >> 1) & 5
    whole[4] = -a
    whole[5] = abs(a) if (a < b and not b == 2) or a == 7 else int(x[2])
    out[0], out[1] = a / b, x[0] ** 2 + x[1] * a
    out[2], out[3] = min(x[0], x[1], 0.5), max(x[1], x[0])
    out[4] = abs(x[1]) - float(a)
    out[5] = 1.0 if 0 < a < b <= 3 else math.inf
    out[6], out[7] = math.sqrt(2 + a * a), math.exp(0.1 * a) + math.log(b)
    return a * b


@bare
def control(n, x, out, whole) -> int:
    found = last = 0
    total = 0.0
    for i in range(n):
        if i % 2 == 1:
            continue
        j = 0
        while True:
            j += 1
            if j > i or (j == 4 and WANTED):
                break
            total += TABLE[i % 2, j % 2] * j
        i = 100  # the count goes on
        last = j
    for k in range(n - 1, -1, -2):
        found = 10 * found + k
    for weight, shift in ((2.0, 1), (0.5, 3)):
        if shift == 3 and n > 6:
            continue
        total, last = weight * total, last + shift
    part, found = split(total - 5.0, found)
    out[0], out[1] = total, part
    fill(out, x[0])
    if not WANTED:
        out[1] = whole.unheard_of
    whole[0], whole[1] = found, last
    flag = total > 1.0 and n > 2
    flag = flag or n == 1
    return 1 if flag else 0


@bare
def arrays(m, flags, out, whole) -> int:
    first, second = m[0], m[1]
    for j in range(m.shape[1]):
        first[j], second[j] = second[j], first[j]
        flags[1, j] = first[j] > 0.0
    if flags[1, 0]:
        out[0] = element(row(m, 1), 1)
    out[1] = math.nan
    whole[1] = take(whole, 3)
    whole[2] = m.size
    ahead(row(m, 0), m.size)
    column = flat(m)
    column[4, 0] = column[1, 0] + column.shape[0]
    left, places = 84, 0
    while left != 0:
        places = 10 * places + lowest(left)
        left &= left - 1
    whole[0] = places
    whole[3] = 1 if math.isnan(out[1]) and not math.isfinite(out[1]) else 0
    return m.shape[0]


def both(function, kinds, *arguments):
    """Return what Python and what the translation make of the same arguments: results, and arrays written to."""
    found = []
    code = load_object(compile_object(loop_assembly(function, kinds), straight=False))

    def translated(*given):
        words = packed(given)
        return ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)(code.address("entry"))(words.ctypes.data)

    for call in (function, translated):
        given = [a.copy() if isinstance(a, np.ndarray) else a for a in arguments]
        with np.errstate(invalid="ignore"):
            found.append((call(*given), [a for a in given if isinstance(a, np.ndarray)]))
    return found


def assert_same(found):
    (result, arrays), (translated, others) = found
    assert result == translated
    for array, other in zip(arrays, others, strict=True):
        np.testing.assert_array_equal(array, other)


@pytest.mark.parametrize("a", [-7, -1, 0, 2, 7])
@pytest.mark.parametrize("b", [1, 2, 3])
@pytest.mark.parametrize("x", [(0.25, -3.0, -2.75), (7.5, math.inf, 1e9), (math.nan, 1.0, 0.0), (1.0, math.nan, 3.9)])
def test_arithmetic_is_that_of_python(a, b, x):
    kinds = Group((INTEGER,) * 2), VECTOR, VECTOR, INTEGERS
    assert_same(both(arithmetic, kinds, (a, b), np.array(x), np.zeros(8), np.zeros(6, np.int64)))


@pytest.mark.parametrize("n", range(9))
def test_control_is_that_of_python(n):
    kinds = INTEGER, VECTOR, VECTOR, INTEGERS
    assert_same(both(control, kinds, n, np.array([0.5]), np.zeros(5), np.zeros(2, np.int64)))


def test_arrays_are_those_of_python():
    kinds = MATRIX, ARRAY_OF_FLAGS, VECTOR, INTEGERS
    m, flags = np.array([[1.0, -2.0, 3.0], [4.0, 5.0, -6.0]]), np.zeros((2, 3), np.bool_)
    assert_same(both(arrays, kinds, m, flags, np.zeros(2), np.arange(4)))


@pytest.mark.parametrize("module", [explicit, implicit, lanes, march, samples, single])
def test_the_same_loop_gives_the_same_text(module):
    assert loop_assembly(module.LOOP, module.KINDS) == loop_assembly(module.LOOP, module.KINDS)


@bare
def negative(x) -> int:
    x[-1] = 0.0
    return 0


@bare
def two_kinds(x) -> int:
    total = 0
    total += x[0]
    return total


@bare
def unknown_call(x) -> int:
    return sorted(x)


@bare
def unmarked_call(x) -> int:
    assert_same(x)
    return 0


@bare
def too_early(x) -> int:
    x[0] = later  # noqa: F821
    later = 1.0  # noqa: F841
    return 0


@bare
def cube(x) -> int:
    x[0] = x[0] ** 3
    return 0


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (negative, "never a negative one"),
        (two_kinds, "total: .* does not fit"),
        (unknown_call, "sorted.* has no translation"),
        (unmarked_call, "assert_same.* has no translation"),
        (too_early, "later has no value yet"),
        (cube, "only power is the square"),
        (numbers, "says so"),
    ],
)
def test_what_has_no_translation_is_refused(function, message):
    with pytest.raises(TypeError, match=message):
        loop_assembly(function, (VECTOR, VECTOR) if function is numbers else (VECTOR,))


def test_a_fault_names_the_line():
    with pytest.raises(TypeError, match=rf"test_machine.py, line {cube.__code__.co_firstlineno + 2}"):
        loop_assembly(cube, (VECTOR,))
