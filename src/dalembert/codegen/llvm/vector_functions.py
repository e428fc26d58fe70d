"""Functions of vectors of doubles that no instruction computes: sine and cosine, rough logarithm and power.

Their text is that of templates, which get their numbers here. It is the same for any number of lanes, so that a case
computes the same bits alone and beside others.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ...once import once
from .target import bits, constant, fma_name, integer, suffix, vector

LIBRARY = {
    name: 2 if name in ("atan2", "pow") else 1
    for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "sinh", "cosh", "tanh", "pow")
}
"""Functions of the C library, with the number of their arguments."""

SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)
HALF_PI = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
LARGEST_ANGLE = 1.0e6
"""Below it in magnitude, sine and cosine are good to 2 units in the last place; beyond, the C library takes over."""
ROUNDING = 6755399441055744.0  # 1.5 * 2**52: adding it rounds to an integer and leaves that in the low bits
TWO_OVER_PI = 0.6366197723675814
_LOG2 = {
    "scale": 2.0**-40,
    "offset": -(2.0**12) - 1023.0 - 0.67487762,
    "quadratic": -0.34484829,
    "linear": 1.02466557,
}
_EXP2 = (0.99992807, 0.69326099, 0.24261114, 0.05517167)
"""2**x for x from -1/2 to 1/2."""


@once
def prelude_variables(lanes: int) -> dict[str, Any]:
    """Return the variables of ``llvm/prelude.ll.j2``: the declarations and definitions of every module of kernels.

    On one lane, sines and cosines are those of a vector of two or four angles (see `LanePrinter`).
    """
    return {
        "unary": [name for name, count in LIBRARY.items() if count == 1],
        "binary": [name for name, count in LIBRARY.items() if count == 2],
        "intrinsics": [_types(n) for n in ((1, 2, 4, 8) if lanes == 1 else (lanes,))],
        "sincos": [_sincos_variables(n) for n in ((2, 4) if lanes == 1 else (lanes,))],
        "rough": _rough_variables(lanes),
    }


def shared_constants() -> dict[str, Any]:
    """Return the numbers of the functions below, for other languages: they compute the same there."""
    return {
        "two_over_pi": TWO_OVER_PI,
        "rounding": ROUNDING,
        "half_pi": HALF_PI,
        "sine": SINE,
        "cosine": COSINE,
        "log2": dict(_LOG2),
        "exp2": _EXP2,
    }


def _types(lanes: int) -> dict[str, str]:
    return {"vector": vector(lanes), "suffix": suffix(lanes), "fma": fma_name(lanes)}


def _sincos_variables(lanes: int) -> dict[str, Any]:
    """Return the variables of the template ``llvm/sincos.ll.j2``; `lanes` is 2 or more."""

    def numbers(*values: float) -> list[str]:
        return [constant(value, lanes) for value in values]

    largest, two_over_pi, rounding, half, one = numbers(LARGEST_ANGLE, TWO_OVER_PI, ROUNDING, 0.5, 1.0)
    return {
        **_types(lanes),
        "lanes": lanes,
        "integers": vector(lanes, "i64"),
        "flags": vector(lanes, "i1"),
        "bits": bits(lanes),
        "pair": f"{{{vector(lanes)}, {vector(lanes)}}}",
        "largest": largest,
        "two_over_pi": two_over_pi,
        "rounding": rounding,
        "half": half,
        "one": one,
        "half_pi": numbers(*HALF_PI),
        "sine": numbers(*SINE),
        "cosine": numbers(*COSINE),
        "integer": {
            "zero": integer(0, lanes),
            "one": integer(1, lanes),
            "two": integer(2, lanes),
            "sign_shift": integer(62, lanes),
        },
        "library_sine": lanewise("sin", lanes, "slow.s"),
        "library_cosine": lanewise("cos", lanes, "slow.c"),
    }


def _rough_variables(lanes: int) -> dict[str, Any]:
    """Return the variables of the template ``llvm/rough_functions.ll.j2``."""
    return {
        "vector": vector(lanes),
        "fma": fma_name(lanes),
        "integers": vector(lanes, "i64"),
        "flags": vector(lanes, "i1"),
        "log2": {
            "high_shift": integer(12, lanes),
            "magic": integer(0x4330000000000000, lanes),
            "mantissa": integer(0x000FFFFFFFFFFFFF, lanes),
            "exponent_of_one": integer(0x3FF0000000000000, lanes),
            **{name: constant(value, lanes) for name, value in _LOG2.items()},
        },
        "exp2": {
            "lowest": constant(-1000.0, lanes),
            "highest": constant(1000.0, lanes),
            "rounding": constant(ROUNDING, lanes),
            "exponent_shift": integer(52, lanes),
            "polynomial": [constant(value, lanes) for value in _EXP2],
        },
    }


def lanewise(function: str, lanes: int, target: str, arguments: Sequence[str] = ("%x",)) -> list[str]:
    """Return lines that set ``%target`` to a function of the C library, lane by lane."""
    v = vector(lanes)
    if lanes == 1:
        given = ", ".join(f"double {a}" for a in arguments)
        return [f"%{target} = call double @{function}({given})"]
    lines, whole = [], "undef"
    for lane in range(lanes):
        parts = []
        for place, argument in enumerate(arguments):
            lines.append(f"%{target}.{lane}.{place} = extractelement {v} {argument}, i32 {lane}")
            parts.append(f"double %{target}.{lane}.{place}")
        lines.append(f"%{target}.{lane} = call double @{function}({', '.join(parts)})")
        name = target if lane == lanes - 1 else f"{target}.pack{lane}"
        lines.append(f"%{name} = insertelement {v} {whole}, double %{target}.{lane}, i32 {lane}")
        whole = f"%{name}"
    return lines
