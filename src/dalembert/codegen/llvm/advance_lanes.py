"""Advance of time for all lanes at once, for steps at which nothing else happens in the sweeping loop."""

from __future__ import annotations

from ...once import once
from .assembly import Compiled
from .loops import library_code
from .vector_functions import constant, vector

__all__ = ["pace", "pace_assembly"]

_SMALLEST = 16.0 * 2.220446049250313e-16


def pace_assembly(lanes: int) -> str:
    """Return a module that defines ``i64 pace(ptr clock, ptr step, ptr tally, ptr settings, ptr limits)``.

    It moves the time of every lane whose step was made and neither ends the case nor passes the next time to record,
    counts an attempt, and sets the largest next step. The lanes where more is to be done are left as they are, and
    are the bits of the number that it returns (see `dalembert.integrators.lane_loop`).
    """
    v, flag, bits = vector(lanes), vector(lanes, "i1"), "i1" if lanes == 1 else f"i{lanes}"
    suffix = "f64" if lanes == 1 else f"v{lanes}f64"

    def at(array: str, name: str, row: int) -> list[str]:
        return [
            f"%{name}.at = getelementptr double, ptr %{array}, i64 {row * lanes}",
            f"%{name} = load {v}, ptr %{name}.at, align 8",
        ]

    def every(name: str, place: int) -> list[str]:
        one = name if lanes == 1 else f"{name}.one"
        load = [
            f"%{name}.at = getelementptr double, ptr %limits, i64 {place}",
            f"%{one} = load double, ptr %{name}.at, align 8",
        ]
        spread = [
            f"%{name}.first = insertelement {v} undef, double %{name}.one, i32 0",
            f"%{name} = shufflevector {v} %{name}.first, {v} undef, <{lanes} x i32> zeroinitializer",
        ]
        return load if lanes == 1 else [*load, *spread]

    tests = [
        ("fcmp olt", "%size", "%rest"),
        ("fcmp oge", "%size", "%smallest"),
        ("fcmp oeq", "%check", constant(0.0, lanes)),
        ("fcmp olt", "%attempts", "%budget"),
        ("fcmp ogt", "%ahead", constant(0.0, lanes)),
    ]
    lines = [
        *at("clock", "now", 0),
        *at("clock", "end", 1),
        *at("clock", "next", 2),
        *at("step", "size", 0),
        *at("step", "check", 1),
        *at("tally", "before", 0),
        *at("settings", "reach", 0),
        *at("settings", "direction", 1),
        *every("largest", 0),
        *every("budget", 1),
        f"%to.go = fsub {v} %end, %now",
        f"%rest = call {v} @llvm.fabs.{suffix}({v} %to.go)",
        f"%age = call {v} @llvm.fabs.{suffix}({v} %now)",
        f"%late = fmul {v} %age, {constant(_SMALLEST, lanes)}",
        f"%short = fmul {v} %rest, {constant(1e-30, lanes)}",
        f"%smallest = fadd {v} %late, %short",
        f"%attempts = fadd {v} %before, {constant(1.0, lanes)}",
        f"%move = fmul {v} %direction, %size",
        f"%then = fadd {v} %now, %move",
        f"%gap = fsub {v} %next, %then",
        f"%ahead = fmul {v} %gap, %direction",
        f"%left = fsub {v} %end, %then",
        f"%far = call {v} @llvm.fabs.{suffix}({v} %left)",
        f"%nearer = fcmp olt {v} %far, %largest",
        f"%most = select {flag} %nearer, {v} %far, {v} %largest",
    ]
    fine = ""
    for place, (test, a, b) in enumerate(tests):
        lines.append(f"%test{place} = {test} {v} {a}, {b}")
        if fine:
            lines.append(f"%fine{place} = and {flag} {fine}, %test{place}")
        fine = f"%fine{place}" if fine else "%test0"
    for name, new, old in (("now", "then", "now"), ("before", "attempts", "before"), ("reach", "most", "reach")):
        lines += [
            f"%{name}.new = select {flag} {fine}, {v} %{new}, {v} %{old}",
            f"store {v} %{name}.new, ptr %{name}.at, align 8",
        ]
    packed = f"%packed = bitcast {flag} {fine} to {bits}"
    lines += [packed, f"%others = xor {bits} %packed, -1", f"%mask = zext {bits} %others to i64", "ret i64 %mask"]
    body = "\n".join(f"  {line}" for line in lines)
    arguments = "ptr %clock, ptr %step, ptr %tally, ptr %settings, ptr %limits"
    return f"declare {v} @llvm.fabs.{suffix}({v})\n\ndefine i64 @pace({arguments}) nounwind {{\n{body}\n}}\n"


@once
def _code(lanes: int) -> Compiled:
    return library_code(f"pace_{lanes}", lambda: pace_assembly(lanes))


def pace(lanes: int) -> int:
    """Return the address of the code for so many lanes."""
    return _code(lanes).address("pace")
