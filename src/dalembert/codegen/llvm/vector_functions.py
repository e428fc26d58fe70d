"""Functions of LLVM vectors of doubles that no instruction computes: sine and cosine, rough logarithm and power.

Written once for any number of lanes, one included, so that a case computes the same bits alone and
beside others.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

__all__ = ["constant", "lanewise", "repeating", "rough_exp2", "rough_log2", "sincos", "vector"]


def vector(lanes: int, element: str = "double") -> str:
    """Return the LLVM type of a pack."""
    return element if lanes == 1 else f"<{lanes} x {element}>"


def constant(value: float, lanes: int) -> str:
    """Return an exact literal in every lane."""
    digits = f"0x{struct.unpack('>Q', struct.pack('>d', value))[0]:016X}"
    return digits if lanes == 1 else f"<{', '.join(f'double {digits}' for _ in range(lanes))}>"


def _integer(value: int, lanes: int) -> str:
    return str(value) if lanes == 1 else f"<{', '.join(f'i64 {value}' for _ in range(lanes))}>"


_SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
_COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)
_HALF_PI = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
_LARGEST = 1.0e6
_ROUNDING = 6755399441055744.0  # 1.5 * 2**52: adding it rounds to an integer and leaves that in the low bits


def _polynomial(name: str, x: str, coefficients: Sequence[float], lanes: int, fma: str) -> list[str]:
    """Return lines that compute ``name``, a polynomial in ``x``, constant term first."""
    v = vector(lanes)
    lines, total = [], constant(coefficients[-1], lanes)
    for place, coefficient in enumerate(reversed(coefficients[:-1])):
        target = name if place == len(coefficients) - 2 else f"{name}.{place}"
        lines.append(f"{target} = call {v} @{fma}({v} {total}, {v} {x}, {v} {constant(coefficient, lanes)})")
        total = target
    return lines


def sincos(lanes: int, fma: str) -> str:
    """Return the definition of ``@sincosN`` for N lanes: fdlibm's polynomials after reduction by pi/2 in three parts.

    Below 1e6 in magnitude it is accurate to 2 units in the last place; beyond, the C library takes over.
    """
    v, w = vector(lanes), vector(lanes, "i64")

    def c(value: float) -> str:
        return constant(value, lanes)

    flag = "%large" if lanes == 1 else "%any"
    any_lane = []
    if lanes > 1:
        any_lane = [
            f"%bits = bitcast <{lanes} x i1> %large to i{lanes}",
            f"%any = icmp ne i{lanes} %bits, 0",
        ]
    slow_sin, slow_cos = lanewise("sin", lanes, "slow.s"), lanewise("cos", lanes, "slow.c")
    lines = [
        f"define internal {{{v}, {v}}} @sincos{lanes}({v} %x) alwaysinline nounwind {{",
        "entry:",
        f"%size = call {v} @llvm.fabs.{_suffix(lanes)}({v} %x)",
        f"%large = fcmp ugt {v} %size, {c(_LARGEST)}",
        *any_lane,
        f"%shifted = call {v} @{fma}({v} %x, {v} {c(0.6366197723675814)}, {v} {c(_ROUNDING)})",
        f"%k = fsub {v} %shifted, {c(_ROUNDING)}",
        f"%q = bitcast {v} %shifted to {w}",
        f"%minus = fneg {v} %k",
        f"%r1 = call {v} @{fma}({v} %minus, {v} {c(_HALF_PI[0])}, {v} %x)",
        f"%r2 = call {v} @{fma}({v} %minus, {v} {c(_HALF_PI[1])}, {v} %r1)",
        f"%r = call {v} @{fma}({v} %minus, {v} {c(_HALF_PI[2])}, {v} %r2)",
        f"%z = fmul {v} %r, %r",
        *_polynomial("%sp", "%z", _SINE, lanes, fma),
        *_polynomial("%cp", "%z", _COSINE, lanes, fma),
        f"%rz = fmul {v} %r, %z",
        f"%sine = call {v} @{fma}({v} %rz, {v} %sp, {v} %r)",
        f"%hz = fmul {v} %z, {c(0.5)}",
        f"%one = fsub {v} {c(1.0)}, %hz",
        f"%lost = fsub {v} {c(1.0)}, %one",
        f"%rest = fsub {v} %lost, %hz",
        f"%zz = fmul {v} %z, %z",
        f"%tail = call {v} @{fma}({v} %zz, {v} %cp, {v} %rest)",
        f"%cosine = fadd {v} %one, %tail",
        f"%low = and {w} %q, {_integer(1, lanes)}",
        f"%odd = icmp ne {w} %low, {_integer(0, lanes)}",
        f"%s.a = select {vector(lanes, 'i1')} %odd, {v} %cosine, {v} %sine",
        f"%c.a = select {vector(lanes, 'i1')} %odd, {v} %sine, {v} %cosine",
        f"%s.bit = and {w} %q, {_integer(2, lanes)}",
        f"%s.sign = shl {w} %s.bit, {_integer(62, lanes)}",
        f"%q1 = add {w} %q, {_integer(1, lanes)}",
        f"%c.bit = and {w} %q1, {_integer(2, lanes)}",
        f"%c.sign = shl {w} %c.bit, {_integer(62, lanes)}",
        f"%s.i = bitcast {v} %s.a to {w}",
        f"%c.i = bitcast {v} %c.a to {w}",
        f"%s.x = xor {w} %s.i, %s.sign",
        f"%c.x = xor {w} %c.i, %c.sign",
        f"%s.f = bitcast {w} %s.x to {v}",
        f"%c.f = bitcast {w} %c.x to {v}",
        f"br i1 {flag}, label %slow, label %done",
        "slow:",
        *slow_sin,
        *slow_cos,
        # the neighbours of a large argument keep what they would have alone
        f"%s.l = select {vector(lanes, 'i1')} %large, {v} %slow.s, {v} %s.f",
        f"%c.l = select {vector(lanes, 'i1')} %large, {v} %slow.c, {v} %c.f",
        "br label %done",
        "done:",
        f"%s = phi {v} [%s.f, %entry], [%s.l, %slow]",
        f"%c = phi {v} [%c.f, %entry], [%c.l, %slow]",
        f"%pair = insertvalue {{{v}, {v}}} undef, {v} %s, 0",
        f"%both = insertvalue {{{v}, {v}}} %pair, {v} %c, 1",
        f"ret {{{v}, {v}}} %both",
        "}",
    ]
    return "\n".join(lines)


def lanewise(function: str, lanes: int, target: str, arguments: Sequence[str] = ("%x",)) -> list[str]:
    """Return lines that set ``%target`` to a function of the C library, lane by lane."""
    v = vector(lanes)
    if lanes == 1:
        given = ", ".join(f"double {a}" for a in arguments)
        return [f"%{target} = call double @{function}({given})"]
    lines, pack = [], "undef"
    for lane in range(lanes):
        parts = []
        for place, argument in enumerate(arguments):
            lines.append(f"%{target}.{lane}.{place} = extractelement {v} {argument}, i32 {lane}")
            parts.append(f"double %{target}.{lane}.{place}")
        lines.append(f"%{target}.{lane} = call double @{function}({', '.join(parts)})")
        name = target if lane == lanes - 1 else f"{target}.pack{lane}"
        lines.append(f"%{name} = insertelement {v} {pack}, double %{target}.{lane}, i32 {lane}")
        pack = f"%{name}"
    return lines


def repeating(function: str, lanes: int) -> str:
    """Return the definition of ``@FUNCTION_repeating``, a function of the C library in every lane.

    A lane whose argument has the bits of the last one's takes over its value: many cases begin alike.
    """
    v, lines, pack = vector(lanes), [], "undef"
    for lane in range(lanes):
        lines += [f"%x{lane} = extractelement {v} %x, i32 {lane}", f"%bits{lane} = bitcast double %x{lane} to i64"]
        if lane:
            lines += [
                f"%same{lane} = icmp eq i64 %bits{lane}, %bits{lane - 1}",
                f"br i1 %same{lane}, label %known{lane}, label %new{lane}",
                f"new{lane}:",
                f"%value{lane} = call double @{function}(double %x{lane})",
                f"br label %known{lane}",
                f"known{lane}:",
                f"%y{lane} = phi double [%y{lane - 1}, %{'entry' if lane == 1 else f'known{lane - 1}'}], "
                f"[%value{lane}, %new{lane}]",
            ]
        else:
            lines.append(f"%y0 = call double @{function}(double %x0)")
    for lane in range(lanes):
        lines.append(f"%pack{lane} = insertelement {v} {pack}, double %y{lane}, i32 {lane}")
        pack = f"%pack{lane}"
    body = "\n".join(["entry:", *lines, f"ret {v} {pack}"])
    return f"define internal {v} @{function}_repeating({v} %x) nounwind {{\n{body}\n}}"


def _suffix(lanes: int) -> str:
    return "f64" if lanes == 1 else f"v{lanes}f64"


def rough_log2(lanes: int, fma: str) -> str:
    """Return the definition of ``@rough_log2`` for positive normal numbers, good to 0.005.

    The bits of a number, read as an integer, are its logarithm with straight lines between the powers of two; a
    parabola takes off most of what that is wrong by.
    """
    v, w = vector(lanes), vector(lanes, "i64")

    def i(value: int) -> str:
        return _integer(value, lanes)

    def c(value: float) -> str:
        return constant(value, lanes)

    lines = [
        f"define internal {v} @rough_log2({v} %x) alwaysinline nounwind {{",
        f"%i = bitcast {v} %x to {w}",
        f"%high = lshr {w} %i, {i(12)}",
        f"%magic = or {w} %high, {i(0x4330000000000000)}",
        f"%float = bitcast {w} %magic to {v}",
        f"%m.raw = and {w} %i, {i(0x000FFFFFFFFFFFFF)}",
        f"%m.one = or {w} %m.raw, {i(0x3FF0000000000000)}",
        f"%m = bitcast {w} %m.one to {v}",
        f"%line = call {v} @{fma}({v} %float, {v} {c(2.0**-40)}, {v} {c(-(2.0**12) - 1023.0 - 0.67487762)})",
        f"%slope = call {v} @{fma}({v} {c(-0.34484829)}, {v} %m, {v} {c(1.02466557)})",
        f"%log = call {v} @{fma}({v} %slope, {v} %m, {v} %line)",
        f"ret {v} %log",
        "}",
    ]
    return "\n".join(lines)


def rough_exp2(lanes: int, fma: str) -> str:
    """Return the definition of ``@rough_exp2``, good to 1e-4 relative; the argument is held within +-1000."""
    v, w = vector(lanes), vector(lanes, "i64")
    flag = vector(lanes, "i1")
    low, high, rounding = constant(-1000.0, lanes), constant(1000.0, lanes), constant(_ROUNDING, lanes)
    coefficients = (0.99992807, 0.69326099, 0.24261114, 0.05517167)
    lines = [
        f"define internal {v} @rough_exp2({v} %x) alwaysinline nounwind {{",
        f"%above = fcmp ogt {v} %x, {low}",
        f"%x.low = select {flag} %above, {v} %x, {v} {low}",
        f"%below = fcmp olt {v} %x.low, {high}",
        f"%x.held = select {flag} %below, {v} %x.low, {v} {high}",
        f"%shifted = fadd {v} %x.held, {rounding}",
        f"%whole = fsub {v} %shifted, {rounding}",
        f"%r = fsub {v} %x.held, %whole",
        f"%i = bitcast {v} %shifted to {w}",
        f"%exponent = shl {w} %i, {_integer(52, lanes)}",
        *_polynomial("%p", "%r", coefficients, lanes, fma),
        f"%p.bits = bitcast {v} %p to {w}",
        f"%bits = add {w} %p.bits, %exponent",
        f"%power = bitcast {w} %bits to {v}",
        f"ret {v} %power",
        "}",
    ]
    return "\n".join(lines)
