"""Translation of loops from Python: results are those of Python, and code without translation is named."""

import ctypes
import importlib
import itertools
import math
import pkgutil
import re
import sys
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import pytest

from dalembert.codegen.llvm.assembly import compile_object, load_object
from dalembert.codegen.llvm.loops import SOURCES
from dalembert.codegen.llvm.target import target
from dalembert.codegen.subset import loop_assembly
from dalembert.codegen.subset.definitions import definition_of
from dalembert.subset import compiled_subset as compiled_subset_module
from dalembert.subset.arguments import Record, Vector
from dalembert.subset.compiled_subset import compiled_subset, fma
from dalembert.subset.packing import address_of, pack
from subset.small_loops import Arithmetic, Arrays, Control, Pair, Records, Tally, arithmetic, arrays, control, records

LOOPS = (
    "event_lane_loop", "explicit_loop", "implicit_loop", "kernel_rows", "lane_loop", "phase_loop", "prepared_loop",
    "projected_lane_loop", "sample_projection", "taylor_loop",
)  # fmt: skip


def loop_of(name):
    module, function, _ = SOURCES[name]
    return pkgutil.resolve_name(f"dalembert.{module}:{function}")


class Numbers(NamedTuple):
    x: Vector


class Untyped(NamedTuple):
    x: np.ndarray


def copied(argument):
    if isinstance(argument, np.ndarray):
        return argument.copy()
    if isinstance(argument, Record):
        return type(argument)(argument.words.copy())
    return argument


def written(arguments):
    arrays = [a for a in arguments if isinstance(a, np.ndarray)]
    return arrays + [a.words for a in arguments if isinstance(a, Record)]


def both(function, arguments):
    """Return what Python and what the translation make of the same arguments: results, and arrays written to."""
    found = []
    code = load_object(compile_object(loop_assembly(function), "loops"))
    entry = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)(code.address("entry"))

    def translated(given):
        packed_args = pack(given)
        return entry(address_of(packed_args))

    for call in (function, translated):
        given = type(arguments)(*(copied(argument) for argument in arguments))
        with np.errstate(all="ignore"):
            found.append((call(given), written(given)))
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
    assert_same(both(arithmetic, Arithmetic(Pair(a, b), np.array(x), np.zeros(8), np.zeros(6, np.int64))))


@pytest.mark.parametrize("n", range(9))
def test_control_is_that_of_python(n):
    assert_same(both(control, Control(n, np.array([0.5]), np.zeros(5), np.zeros(2, np.int64))))


def test_arrays_are_those_of_python():
    m, flags = np.array([[1.0, -2.0, 3.0], [4.0, 5.0, -6.0]]), np.zeros((2, 3), np.bool_)
    assert_same(both(arrays, Arrays(m, flags, np.zeros(2), np.arange(4))))


@pytest.mark.parametrize("doubled", [False, True])
def test_records_are_those_of_python(doubled):
    tally = Tally()
    tally.total, tally.steps, tally.last = 0.5, 1, -3.0
    found = both(records, Records(doubled, 0.25, Pair(0, 4), tally, np.array([1.0, 2.0, 4.0, 8.0])))
    assert_same(found)
    assert found[0][0] == 4
    changed = Tally(found[1][1][1])
    assert (changed.total, changed.steps, changed.last) == ((2.0 if doubled else 1.0) * 1.25, 4, 8.0)


@pytest.mark.parametrize("name", LOOPS)
def test_the_same_loop_gives_the_same_text(name):
    assert loop_assembly(loop_of(name)) == loop_assembly(loop_of(name))


class Fused(NamedTuple):
    x: Vector
    out: Vector


@compiled_subset
def sums(arguments: Fused) -> int:
    x, out = arguments.x, arguments.out
    out[0], out[1] = x[0] * x[1] + x[2], fma(x[0], x[1], x[2])
    out[2], out[3] = x[2] - x[0] * x[1], fma(-x[0], x[1], x[2])
    return 0


NUMBERS = (1.0 + 2.0**-30, -1.0 + 2.0**-30, 5e-324, -3e-308, 2.0**-1022, 1.7e308, -1.7e308, 0.1, -1.0, 0.0)


@pytest.fixture
def fused(monkeypatch):
    """Let plain Python round `fma` once, whatever earlier tests have said of the target."""
    monkeypatch.setitem(compiled_subset_module._TARGET, "fused", True)


@pytest.mark.usefixtures("fused")
def test_plain_python_fuses_as_exact_fractions_round():
    for a, b, c in itertools.product(NUMBERS, repeat=3):
        exact = Fraction(a) * Fraction(b) + Fraction(c)
        if exact:
            size = float(abs(exact)) if abs(exact) < 2**1024 - 2**970 else math.inf
            with np.errstate(all="ignore"):
                found = fma(np.float64(a), np.float64(b), np.float64(c))
            assert abs(found) == size and (math.copysign(1.0, found) > 0.0) == (exact > 0)


@pytest.mark.usefixtures("fused")
def test_products_and_sums_are_fused_where_the_loop_says_so():
    """(1 + e)(1 - e) is 1 - e^2, which rounds to 1."""
    e = 2.0**-30
    found = both(sums, Fused(np.array([1.0 + e, 1.0 - e, -1.0]), np.zeros(4)))
    assert_same(found)
    out = found[1][1][1]
    assert (out[0], out[2]) == (0.0, -2.0)
    if target().fused:
        assert out[1] == -(2.0**-60)
    assert "@llvm.fma." not in loop_assembly(sums, fused=False)


@pytest.mark.parametrize("name", LOOPS)
def test_nothing_else_is_fused_or_reassociated(name):
    text = loop_assembly(loop_of(name))
    assert not re.search(r"\bf(add|sub|mul|div) (?!double)", text)
    assert "fmuladd" not in text


@compiled_subset
def negative(arguments: Numbers) -> int:
    x = arguments.x
    x[-1] = 0.0
    return 0


@compiled_subset
def two_kinds(arguments: Numbers) -> int:
    x = arguments.x
    total = 0
    total += x[0]
    return total


@compiled_subset
def unknown_call(arguments: Numbers) -> int:
    x = arguments.x
    return sorted(x)


@compiled_subset
def unmarked_call(arguments: Numbers) -> int:
    x = arguments.x
    assert_same(x)
    return 0


@compiled_subset
def too_early(arguments: Numbers) -> int:
    x = arguments.x
    x[0] = later  # noqa: F821
    later = 1.0  # noqa: F841
    return 0


@compiled_subset
def power(arguments: Numbers) -> int:
    arguments.x[0] = arguments.x[0] ** 2
    return 0


@compiled_subset
def unsaid(arguments: Numbers):
    return 0


@compiled_subset
def no_field(arguments: Records) -> int:
    arguments.tally.unheard_of = 1
    return 0


@compiled_subset
def not_a_record(arguments: Records) -> int:
    arguments.factor = 1.0
    return 0


@compiled_subset
def untyped(arguments: Untyped) -> int:
    return 0


@compiled_subset
def several(x: Vector, y: Vector) -> int:
    return 0


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (negative, "never a negative one"),
        (two_kinds, "total: .* does not fit"),
        (unknown_call, "sorted.* has no translation"),
        (unmarked_call, "assert_same.* has no translation"),
        (too_early, "later has no value yet"),
        (power, "no powers, and `square`"),
        (unsaid, "is annotated so"),
        (no_field, "no unheard_of that could be read or changed"),
        (not_a_record, "no factor that could be read or changed"),
        (untyped, "is not a type of arguments of compiled loops"),
        (several, "a loop takes one NamedTuple"),
    ],
)
def test_what_has_no_translation_is_refused(function, message):
    with pytest.raises(TypeError, match=message):
        loop_assembly(function)


def test_a_fault_names_the_line():
    with pytest.raises(TypeError, match=rf"test_subset.py, line {power.__code__.co_firstlineno + 2}"):
        loop_assembly(power)


def test_a_function_that_has_moved_since_its_import_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "moving.py"
    path.write_text("def before(x: float) -> float:\n    return x\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "moving", raising=False)
    moving = importlib.import_module("moving")
    path.write_text("def another(x: float) -> float:\n    return -x\n")
    with pytest.raises(TypeError, match="has no before in line 1: start Python anew"):
        definition_of(moving.before)
