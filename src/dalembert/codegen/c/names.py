"""Names in C: those that have a meaning there, and those of public functions and members."""

from __future__ import annotations

from ...naming import Namer

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
