"""Single precision: printed C with `float` in place of `double`, and tests that allow for its rounding."""

from __future__ import annotations

import re
from dataclasses import replace

from ...errors import CapabilityError
from ...ir.kernel import Assignment, Kernel
from ...reduction.starting import Start
from ...transforms.linear import SET_ASIDE
from ...transforms.taylor.nonsmooth import pivot_comparisons
from .printing import SINGLE

_WORDS = {"double": "float", "DBL_MAX": "FLT_MAX", "FP_FAST_FMA": "FP_FAST_FMAF", **SINGLE}
_LARGEST, _SMALLEST = 3.4028234663852886e38, 1.1754943508222875e-38
_TOKEN = re.compile(
    r'(?P<kept>/\*.*?\*/|"(?:\\.|[^"\\])*")'
    r"|(?P<number>(?<![\w.])(?:\d+\.\d*|\d+(?=[eE]))(?:[eE][+-]?\d+)?(?![\w.]))"
    r"|(?P<word>[A-Za-z_]\w*)",
    re.DOTALL,
)


def in_single(text: str) -> str:
    """Return a text of C in single precision: types, literals, and functions of the C library.

    Raises
    ------
    CapabilityError
        For a literal that no float holds.
    """
    return _TOKEN.sub(_single, text)


def _single(token: re.Match[str]) -> str:
    if token["number"]:
        return single(float(token["number"]))
    return _WORDS.get(token[0], token[0]) if token["word"] else token[0]


def single(number: float) -> str:
    """Return the literal of a float next to a number that is not negative; one that is not 0 does not become 0.

    Raises
    ------
    CapabilityError
        For a number that no float holds.
    """
    if number > _LARGEST:
        raise CapabilityError(
            f'a constant of the equations, {number!r}, is beyond the range of float (3.4e38): leave precision="double",'
            " or choose other units"
        )
    return f"{max(number, _SMALLEST) if number else number!r}f"


# Tests, whose limits grow with rounding.

_ROUNDING = 2.0**29
"""Rounding of floats over that of doubles."""

_SET_ASIDE = 1e30
"""Pivot in place of one that counts as zero."""


def kernel_in_single(kernel: Kernel) -> Kernel:
    """Return a kernel that sets pivots aside where they are next to nothing beside the rounding of floats."""
    guards, body = pivot_comparisons(kernel), list[Assignment]()
    for line in kernel.body:
        args = tuple(_SET_ASIDE if arg == SET_ASIDE else arg for arg in line.args)
        if line.target in guards:  # of (least, pivot)
            body.append(Assignment(f"{line.target}_least_", "mul", (args[0], _ROUNDING)))
            args = (f"{line.target}_least_", *args[1:])
        body.append(replace(line, args=args))
    return replace(kernel, body=tuple(body))


_WIDER = {"positions": 1e3, "rates": 1e3, "coordinates changed": 1e2, "rates changed": 1e2}
"""Kind of a test of starts, and the factor of what may be left: of constraints then 1e-5 of their terms."""

_STRICTER = dict.fromkeys(("pivots", "inertia", "coordinates left out", "rates left out"), _ROUNDING)
"""Kind of a test of starts, and the factor of what the size of a pivot must exceed."""


def start_in_single(start: Start) -> Start:
    """Return a start whose tests pass what rounding to single precision leaves."""
    kernel, first = start.kernel, len(start.kernel.outputs) - 2 * len(start.labels)
    outputs, body = list(kernel.outputs), list(kernel.body)
    for number, (kind, _) in enumerate(start.labels):
        place = first + 2 * number + (kind in _WIDER)
        factor = _WIDER.get(kind, _STRICTER.get(kind))
        if factor is not None:
            body.append(Assignment(f"tested_{number}_", "mul", (outputs[place], factor)))
            outputs[place] = f"tested_{number}_"
    return replace(start, kernel=replace(kernel, body=tuple(body), outputs=tuple(outputs)))
