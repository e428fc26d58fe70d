"""Names, literals and subscripts in C, and removal of statements without influence."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Sequence
from functools import lru_cache

from ...naming import Namer

_ROW = 108
"""Characters of a line of numbers."""

RESERVED = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if inline int long register"
    " restrict return short signed sizeof static struct switch typedef union unsigned void volatile while bool true"
    " false NULL NAN INFINITY EOF".split()
)
"""Keywords, and macros of the headers that are included."""

SINGLE = {
    name: f"{name}f"
    for name in "acos asin atan atan2 cos sin tan cosh sinh tanh exp log pow sqrt fabs floor fma".split()
}
"""Functions of the C library, and their forms in single precision."""

FUNCTIONS = frozenset(SINGLE.values()) | frozenset(
    "acos asin atan atan2 cos sin tan cosh sinh tanh exp frexp ldexp log log10 modf pow sqrt ceil fabs floor fmod"
    " fma memcpy memset isfinite isnan copysign fused angle angle_of rough_log2 rough_exp2 scaled exponent_of"
    " significand_of tan_of exp_of log_of tanh_of atan_of atan2_of pow_of rest_of quotient_of least greatest"
    " least_integer greatest_integer size_of_integer lowest_bit run result main".split()
)
"""Functions that the code calls, or that compilers know."""


class Pointer(str):
    """A word that is the address of numbers."""


class Fixed(Pointer):
    """A word that is the address of numbers that never change."""


class Code(Pointer):
    """A word that is the address of a kernel, or 0 where there is none."""


class Known(Pointer):
    """A word that means the same in every function: the name of a kernel or of a constant array, or a member."""


class Constant(Known):
    """A word that is the name of an array that never changes."""


class Kernel(Known):
    """A word that is the name of a kernel."""


class Loop(Known):
    """A word that is the name of a loop, or a table of such names: loops take the whole run."""


def c_name(name: str) -> str:
    """Return the name in C of a variable of a loop."""
    return f"{name}_" if name in RESERVED or name in FUNCTIONS else name


def member_name(name: str) -> str:
    """Return the name in C of a field of the arguments of a loop."""
    return f"{name}_" if name in RESERVED else name


def prefix_of(name: str) -> str:
    """Return the prefix of everything public that belongs to a scene: its name in lower case."""
    return Namer({*RESERVED, *FUNCTIONS})(name.lower())


def identifiers(names: tuple[str, ...]) -> list[str]:
    """Return a different identifier for each name."""
    namer = Namer({*RESERVED, *FUNCTIONS})
    return [namer(name) for name in names]


def bare(word: str) -> str:
    """Return an expression without the parentheses around all of it."""
    if not (word.startswith("(") and word.endswith(")")):
        return word
    depth = 0
    for place, character in enumerate(word):
        depth += (character == "(") - (character == ")")
        if depth == 0 and place < len(word) - 1:
            return word
    return word[1:-1]


def element_of(data: str, offset: str) -> str:
    """Return the element of an array at an offset, which may be that of a row of another."""
    if data.startswith("&") and data.endswith("]"):
        base, _, first = data[1:-1].partition("[")
        return (
            f"{base}[{bare(offset)}]" if first == "0" else f"{base}[{first}{'' if offset == '0' else f' + {offset}'}]"
        )
    return f"{data}[{bare(offset)}]"


def double(number: float) -> str:
    """Return an exact literal of a double."""
    if math.isnan(number):
        return "NAN"
    if math.isinf(number):
        return "INFINITY" if number > 0 else "(-INFINITY)"
    text = repr(float(number))
    return f"({text})" if text.startswith("-") else text


def rows_of(numbers: Sequence[str]) -> list[str]:
    """Return the elements of an array as lines, with commas between them."""
    rows: list[str] = []
    for place, number in enumerate(numbers):
        text = number if place == len(numbers) - 1 else f"{number},"
        if rows and len(rows[-1]) + len(text) < _ROW:
            rows[-1] += f" {text}"
        else:
            rows.append(text)
    return rows


NAME = re.compile(r"(?<![\w.>])[A-Za-z_]\w*")
"""A name in C, and not a member of something."""


@lru_cache(maxsize=1 << 13)
def names_in(text: str) -> tuple[str, ...]:
    """Return the names in a line or an expression of C; the same few make up the functions of all exports."""
    return tuple(NAME.findall(text))


_ASSIGNED = re.compile(r"\s*(\w+) = (.*);")
_PART = re.compile(r"(part_\d+) = (.*);")
_CALL = re.compile(r"\w+\(.*\)")
_BLOCKS = ("if (", "for (")


def tidied(lines: list[str], variables: Collection[str], functions: Collection[str]) -> list[str]:
    """Return the lines of a function without what has no influence.

    Parameters
    ----------
    lines : list of str
        Statements; blocks begin with ``{`` at the end of a line, and end with a line of their own.
    variables : collection of str
        Variables of the function.
    functions : collection of str
        Functions that may change memory; others are of their arguments alone.
    """
    while True:
        kept = _without_empty_blocks(_without_unread(lines, variables, functions))
        if kept == lines:
            return _without_detours(lines)
        lines = kept


def _without_unread(lines: list[str], variables: Collection[str], functions: Collection[str]) -> list[str]:
    """Return lines without assignments to variables that are never read; calls among them stay."""
    assigned = [found if found[0] in variables else ("", line) for line in lines for found in [_assigned(line)]]
    read = {name for _, text in assigned for name in names_in(text)}
    kept = []
    for line, (variable, value) in zip(lines, assigned, strict=True):
        if not variable or variable in read:
            kept.append(line)
        elif _CALL.fullmatch(value) and value.split("(")[0] in functions:
            kept.append(f"{value};")
    return kept


@lru_cache(maxsize=1 << 13)
def _assigned(line: str) -> tuple[str, str]:
    """Return the name that a line assigns to, empty without one, and the value."""
    found = _ASSIGNED.fullmatch(line)
    return ("", line) if found is None else (found[1], found[2])


def _without_empty_blocks(lines: list[str]) -> list[str]:
    """Return lines without blocks in which nothing is left; loops that count have an end."""
    found: list[str] = []
    for line in lines:
        if line == "}" and found and found[-1].endswith("{") and found[-1].startswith(_BLOCKS):
            found.pop()
        elif line == "}" and found and found[-1] == "} else {":
            found[-1] = line
        else:
            found.append(line)
    return found


def _without_detours(lines: list[str]) -> list[str]:
    """Return lines in which nothing is computed only to be assigned or returned in the next line."""
    counts = Counter(name for line in lines for name in names_in(line))
    found: list[str] = []
    for line in lines:
        before = _PART.fullmatch(found[-1]) if found else None
        ends = before is not None and line.endswith((f" = {before[1]};", f"return {before[1]};"))
        if before is not None and ends and counts[before[1]] == 2:
            found[-1] = f"{line[: -len(before[1]) - 1]}{before[2]};"
        else:
            found.append(line)
    return found
