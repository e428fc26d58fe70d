"""Small loops with everything that the compiled subset has, and their arguments."""

import math
from typing import NamedTuple

import numpy as np

from dalembert.subset.arguments import FlagMatrix, IntVector, Matrix, Record, Vector
from dalembert.subset.compiled_subset import (
    compiled_subset,
    element,
    exp,
    flat,
    log,
    lowest,
    prefetch,
    row,
    sqrt,
    square,
    take,
)

TABLE = np.array([[1.5, -2.0], [0.25, 8.0]])
WANTED = True


class Pair(NamedTuple):
    a: int
    b: int


class Arithmetic(NamedTuple):
    given: Pair
    x: Vector
    out: Vector
    integers: IntVector


class Control(NamedTuple):
    n: int
    x: Vector
    out: Vector
    integers: IntVector


class Arrays(NamedTuple):
    m: Matrix
    flags: FlagMatrix
    out: Vector
    integers: IntVector


class Tally(Record):
    total: float
    steps: int
    last: float


class Records(NamedTuple):
    doubled: bool
    factor: float
    limits: Pair
    tally: Tally
    x: Vector


@compiled_subset
def split(x: float, k: int) -> tuple[float, int]:
    if x < 0.0:
        return -x, k - 1
    return x, k + 1


@compiled_subset
def fill(out, x: float) -> None:
    for i in range(out.size):
        if i == 3:
            return
        out[i] += x


@compiled_subset
def arithmetic(arguments: Arithmetic) -> int:
    x, out, whole = arguments.x, arguments.out, arguments.integers
    a, b = arguments.given
    whole[0], whole[1], whole[2], whole[3] = a // b, a % b, a << 2, (a >> 1) & 5
    whole[4] = -a
    whole[5] = abs(a) if (a < b and not b == 2) or a == 7 else int(x[2])
    out[0], out[1] = a / b, square(x[0]) + x[1] * a
    out[2], out[3] = min(x[0], x[1], 0.5), max(x[1], x[0])
    out[4] = abs(x[1]) - float(a)
    out[5] = 1.0 if 0 < a < b <= 3 else math.inf
    out[6], out[7] = sqrt(2 + a * a), exp(0.1 * a) + log(b)
    return a * b


@compiled_subset
def control(arguments: Control) -> int:
    n, x, out, whole = arguments.n, arguments.x, arguments.out, arguments.integers
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


@compiled_subset
def arrays(arguments: Arrays) -> int:
    m, flags, out, whole = arguments.m, arguments.flags, arguments.out, arguments.integers
    first, second = m[0], m[1]
    for j in range(m.shape[1]):
        first[j], second[j] = second[j], first[j]
        flags[1, j] = first[j] > 0.0
    if flags[1, 0]:
        out[0] = element(row(m, 1), 1)
    out[1] = math.nan
    whole[1] = take(whole, 3)
    whole[2] = m.size
    prefetch(row(m, 0), m.size)
    column = flat(m)
    column[4, 0] = column[1, 0] + column.shape[0]
    left, places = 84, 0
    while left != 0:
        places = 10 * places + lowest(left)
        left &= left - 1
    whole[0] = places
    whole[3] = 1 if math.isnan(out[1]) and not math.isfinite(out[1]) else 0
    return m.shape[0]


@compiled_subset
def advanced(tally: Tally, x: float) -> float:
    tally.steps += 1
    tally.last, before = x, tally.last
    return before


@compiled_subset
def records(arguments: Records) -> int:
    tally, x = arguments.tally, arguments.x
    while tally.steps < arguments.limits.b:
        tally.total += advanced(tally, x[tally.steps]) * arguments.factor
    if arguments.doubled:
        tally.total = 2.0 * tally.total
    return tally.steps
