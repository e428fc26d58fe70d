"""Loops as C: results are those of Python to the last bit, and what has no translation is named."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from codegen.c_programs import OPTIMISED, built, output
from dalembert.codegen.c.kernels import source_of
from dalembert.codegen.c.source import LoopSource
from dalembert.codegen.c.workspace import workspace_of
from dalembert.subset.arguments import Matrix, Record, Vector, kind_of
from dalembert.subset.compiled_subset import Array, Fields, Group, compiled_subset
from subset.small_loops import (
    Arithmetic,
    Arrays,
    Control,
    Pair,
    Records,
    Tally,
    arithmetic,
    arrays,
    control,
    element,
    flat,
    lowest,
    records,
    row,
    split,
)


def leaves(arguments, kind, path=""):
    """Yield the dotted name, the kind and the value of each argument."""
    for name, part, value in zip(kind.names, kind.parts, arguments, strict=True):
        inner = f"{path}.{name}".strip(".")
        if isinstance(part, Group):
            yield from leaves(value, part, inner)
        else:
            yield inner, part, value


def c_results(folder, function, arguments, *, known):
    """Return what the translation makes of arguments: the result, then arrays and records as words.

    Numbers among the arguments are `known` when it is printed, or else set before it is called.
    """
    kind = kind_of(type(arguments))
    found = list(leaves(arguments, kind))
    numbers = {name: value for name, part, value in found if not isinstance(part, Array | Fields)}
    space = workspace_of(arguments, frozenset() if known else frozenset(numbers), frozenset(), {})
    loops = LoopSource(space, "loop", "fused", frozenset())
    call = loops.entry(function, type(arguments))
    setting, printing = [], []
    for name, part, value in found:
        if isinstance(part, Array):
            printing.append((f"run.{name}", value.size, value.dtype.kind))
        elif isinstance(part, Fields):
            for word, item in enumerate(part.names):
                setting.append(f"run.{name}.{item} = {getattr(value, item)!r};".replace("np.float64(", "("))
                printing.append((f"&run.{name}.{item}", 1, "f" if part.items[word].type == "double" else "i"))
        elif not known:
            setting.append(f"run.{name} = {str(value).lower()};")
    setting += [f"run.{place} = {value};" for place, value in space.beginning]
    print_one = {"f": 'printf("%a ", x[k])', "i": 'printf("%lld ", (long long)x[k])', "b": 'printf("%d ", x[k])'}
    types = {"f": "double", "i": "int64_t", "b": "bool"}
    lines = [
        f"{{ const {types[kind]} *x = {place}; int k; for (k = 0; k < {size}; k++) {{ {print_one[kind]}; }} }}"
        for place, size, kind in printing
    ]
    members = space.members_used("", {name for name, part, _ in found if name not in numbers or not known})
    text = source_of(["a loop"], [], "", loops.text, loops.used).replace(
        "#include <string.h>",
        "\n".join(["#include <string.h>", "#include <stdio.h>", "typedef struct {", *members, "} loop_run;"]),
    )
    main = ["int main(void)", "{", "static loop_run run;", *setting, 'printf("%lld ", (long long)call(&run));', *lines]
    text += f"\nstatic int64_t call(loop_run *run) {{ return {call}; }}\n" + "\n".join([*main, "return 0;", "}", ""])
    (folder / "loop.c").write_text(text)
    return output(built(folder, ["loop.c"], *OPTIMISED)).split()


def python_results(function, arguments):
    """Return the same from Python."""
    with np.errstate(all="ignore"):
        results = [str(function(arguments))]
    for _, part, value in leaves(arguments, kind_of(type(arguments))):
        if isinstance(value, np.ndarray):
            results += [printed(x) for x in np.ravel(value)]
        elif isinstance(value, Record):
            results += [printed(getattr(value, name)) for name in part.names]
    return results


def printed(number):
    """Return a number as C prints it."""
    if isinstance(number, float):
        return number
    return str(int(number))


def assert_same(folder, function, make):
    """Assert that C and Python do the same with arguments, which are made anew for each."""
    expected = python_results(function, make())
    for known in (True, False):
        found = c_results(folder, function, make(), known=known)
        assert len(found) == len(expected)
        for ours, theirs in zip(found, expected, strict=True):
            if isinstance(theirs, float):
                number = float("nan") if "nan" in ours else float.fromhex(ours)
                np.testing.assert_equal(number, float(theirs))
            else:
                assert ours == theirs


@pytest.mark.parametrize(
    ("a", "b", "x"),
    [(-7, 3, (0.25, -3.0, -2.75)), (7, 2, (7.5, math.inf, 1e9)), (2, 3, (math.nan, 1.0, 0.0)), (1, 2, (1.0, 2.0, 3.9))],
)
def test_arithmetic_is_that_of_python(tmp_path, a, b, x):
    assert_same(tmp_path, arithmetic, lambda: Arithmetic(Pair(a, b), np.array(x), np.zeros(8), np.zeros(6, np.int64)))


@pytest.mark.parametrize("n", [0, 5, 8])
def test_control_is_that_of_python(tmp_path, n):
    assert_same(tmp_path, control, lambda: Control(n, np.array([0.5]), np.zeros(5), np.zeros(2, np.int64)))


@pytest.mark.parametrize("doubled", [False, True])
def test_records_are_those_of_python(tmp_path, doubled):
    def make():
        tally = Tally()
        tally.total, tally.steps, tally.last = 0.5, 1, -3.0
        return Records(doubled, 0.25, Pair(0, 4), tally, np.array([1.0, 2.0, 4.0, 8.0]))

    assert_same(tmp_path, records, make)


@compiled_subset
def order_of_evaluation(arguments: Arrays) -> int:
    """Read memory before and after calls that change it, and exchange values."""
    m, flags, out, whole = arguments.m, arguments.flags, arguments.out, arguments.integers
    out[0] = out[0] + changed(arguments, 2.0)
    a, b = 1.0, m[0, 0]
    a, b = b, a
    m[0, 1], m[0, 2] = m[0, 2], m[0, 1]
    whole[0], whole[1] = whole[1], whole[0] + whole[1]
    flags[0, 0] = a < b or changed(arguments, 4.0) > 1e9 or changed(arguments, 8.0) > 0.0
    flags[1, 1] = a > 1e9 and changed(arguments, 16.0) > 0.0
    last = m[1]
    last[0], part = split(changed(arguments, 1.0), whole[2])
    whole[2] += part
    while changed(arguments, -1.0) > 6.0:
        whole[3] += 1
    column, size = flat(m), 0.0
    for k in range(0, 3 + whole[3] * 0, 2):
        size += element(row(m, 1), k) + column[k, 0]
    out[1] = size + a - (changed(arguments, 1.0) if size > 1e9 else out[0])
    whole[3] += lowest(40)
    return int(size)


@compiled_subset
def changed(arguments: Arrays, by: float) -> float:
    """Change the first output, and return what it was."""
    before = arguments.out[0]
    arguments.out[0] += by
    return before + by


def test_memory_is_read_in_the_order_of_python(tmp_path):
    def make():
        m, flags = np.array([[1.5, -2.0, 3.0], [4.0, 5.0, -6.0]]), np.zeros((2, 3), np.bool_)
        return Arrays(m, flags, np.array([0.5, 0.0]), np.arange(4))

    assert_same(tmp_path, order_of_evaluation, make)


def test_what_threads_share_is_counted_by_one(tmp_path):
    def make():
        m = np.array([[1.5, -2.0, 3.0], [4.0, 5.0, -6.0]])
        return Arrays(m, np.zeros((2, 3), np.bool_), np.zeros(2), np.arange(4))

    assert_same(tmp_path, arrays, make)


class Shared(NamedTuple):
    """A matrix, and a row and an element of it as arrays of their own."""

    m: Matrix
    row: Vector
    last: Vector


def test_arrays_that_share_memory_share_it_in_c():
    m = np.zeros((2, 3))
    space = workspace_of(Shared(m, m[1], m[1, 2:]), frozenset(), frozenset(), {})
    places = [("run->m", "2", "3"), ("&run->m[3]", "3"), ("&run->m[5]", "1")]
    assert [space.leaf(place) for place in (0, 3, 5)] == places
    assert [name for name, _ in space.members] == ["m"]


def test_arrays_that_overlap_in_part_are_refused():
    memory = np.zeros(4)
    with pytest.raises(TypeError, match="row and m overlap"):
        workspace_of(Shared(memory[:3].reshape(1, 3), memory[1:], np.zeros(1)), frozenset(), frozenset(), {})


def test_known_numbers_leave_no_trace():
    """A branch that is never taken is not printed."""
    space = workspace_of(Records(False, 0.25, Pair(0, 4), Tally(), np.zeros(4)), frozenset(), frozenset(), {})
    loops = LoopSource(space, "loop", "fused", frozenset())
    loops.entry(records, Records)
    assert "2.0 *" not in loops.text and "factor" not in loops.text and "0.25" in loops.text
