"""Whether what a case is made from can be computed with, for all lanes at once."""

from __future__ import annotations

from ...once import once
from .assembly import Compiled
from .loops import library_code
from .vector_functions import constant, vector

__all__ = ["sound", "sound_assembly"]


def sound_assembly(lanes: int) -> str:
    """Return a module that defines ``i64 sound(ptr rows, i64 plain, i64 checks, i64, i64)``.

    The lanes where the first `plain` rows and the `checks` behind them are finite, and in these the magnitude of every
    other number is at most the number in the next row, are the bits of what it returns.
    """
    v, flag, bits = vector(lanes), vector(lanes, "i1"), "i1" if lanes == 1 else f"i{lanes}"
    suffix, zero = "f64" if lanes == 1 else f"v{lanes}f64", constant(0.0, lanes)
    return f"""declare {v} @llvm.fabs.{suffix}({v})

define i64 @sound(ptr %rows, i64 %plain, i64 %checks, i64 %p, i64 %q) nounwind {{
entry:
  %all = add i64 %plain, %checks
  br label %test
test:
  %k = phi i64 [0, %entry], [%k.next, %row]
  %total = phi {v} [{zero}, %entry], [%total.next, %row]
  %more = icmp slt i64 %k, %all
  br i1 %more, label %row, label %pairs
row:
  %place = mul i64 %k, {lanes}
  %at = getelementptr double, ptr %rows, i64 %place
  %value = load {v}, ptr %at, align 8
  %none = fmul {v} %value, {zero}
  %total.next = fadd {v} %total, %none
  %k.next = add i64 %k, 1
  br label %test
pairs:
  %finite = fcmp oeq {v} %total, {zero}
  br label %check
check:
  %m = phi i64 [%plain, %pairs], [%m.next, %pair]
  %good = phi {flag} [%finite, %pairs], [%good.next, %pair]
  %another = icmp slt i64 %m, %all
  br i1 %another, label %pair, label %done
pair:
  %first = mul i64 %m, {lanes}
  %rest.at = getelementptr double, ptr %rows, i64 %first
  %rest = load {v}, ptr %rest.at, align 8
  %most.at = getelementptr double, ptr %rest.at, i64 {lanes}
  %most = load {v}, ptr %most.at, align 8
  %size = call {v} @llvm.fabs.{suffix}({v} %rest)
  %holds = fcmp ole {v} %size, %most
  %good.next = and {flag} %good, %holds
  %m.next = add i64 %m, 2
  br label %check
done:
  %packed = bitcast {flag} %good to {bits}
  %mask = zext {bits} %packed to i64
  ret i64 %mask
}}
"""


@once
def _code(lanes: int) -> Compiled:
    return library_code(f"sound_{lanes}", lambda: sound_assembly(lanes))


def sound(lanes: int) -> int:
    """Return the address of the code for so many lanes."""
    return _code(lanes).address("sound")
