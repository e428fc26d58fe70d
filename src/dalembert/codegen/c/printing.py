"""Names, literals and subscripts in C."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ...naming import Namer

_ROW = 108
"""Characters of a line of numbers."""

RESERVED = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if inline int long register"
    " restrict return short signed sizeof static struct switch typedef union unsigned void volatile while bool true"
    " false NULL NAN INFINITY EOF".split()
)
"""Keywords, and macros of the headers that are included."""

FUNCTIONS = frozenset(
    "acos asin atan atan2 cos sin tan cosh sinh tanh exp frexp ldexp log log10 modf pow sqrt ceil fabs floor fmod"
    " fma memcpy memset isfinite isnan fused angle angle_of rough_log2 rough_exp2 rest_of quotient_of least greatest"
    " least_integer greatest_integer size_of_integer lowest_bit run result main".split()
)
"""Functions that the code calls, or that compilers know."""


def c_name(name: str) -> str:
    """Return the name in C of a variable of a loop."""
    return f"{name}_" if name in RESERVED or name in FUNCTIONS else name


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
