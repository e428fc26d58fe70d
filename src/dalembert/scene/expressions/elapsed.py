"""Expressions of a scene in the time since the start of a run.

Far from zero the doubles of time lie far apart (2e-7 s, where seconds are counted from 1970). A polynomial in time,
such as w*t + phi, is therefore read as one in the elapsed time: what it is at the start becomes a parameter of its own,
which `Offset.value` computes with many digits, modulo the period of the function that it is the argument of.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import field
from functools import cached_property
from typing import Any, final

import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.functions.elementary.piecewise import ExprCondPair
from sympy.physics.vector import dynamicsymbols

from ...frozen import frozen
from ...once import derived_property, deriving

_HIGHEST = 6
"""Largest degree of the polynomials in time that are recognised."""

_BITS = 320
"""Precision of the values at the start: enough for the product of three doubles, modulo a period."""

_PERIODIC = (sp.sin, sp.cos, sp.tan, sp.cot, sp.sec, sp.csc)
_START = sp.Dummy("start", real=True)
START = "time offset"
"""Name of the parameter that is the start itself."""


def time_symbol() -> Any:
    """Return the symbol of time."""
    return dynamicsymbols._t


def timed(e: Any) -> bool:
    """Return whether an expression contains time explicitly, not only as the argument of a coordinate."""
    if e == dynamicsymbols._t:
        return True
    if isinstance(e, sp.Derivative):
        return not isinstance(e.expr, AppliedUndef) and timed(e.doit())
    return not isinstance(e, AppliedUndef) and any(timed(arg) for arg in getattr(e, "args", ()))


@final
@frozen(eq=False)
class Offset:
    """A parameter with the value of an expression of time and parameters at the start of a run.

    Attributes
    ----------
    name : str
        Name of the parameter.
    expression : SymPy expression
        In parameters and the start.
    period : SymPy expression or None
        The value counts modulo this.
    """

    name: str
    expression: Any
    period: Any
    _derivatives: dict[str, Callable[..., Any]] = field(default_factory=dict)

    @cached_property
    def symbol(self) -> Any:
        """The parameter as a symbol."""
        return sp.Symbol(self.name, real=True)

    @cached_property
    def symbols(self) -> tuple[Any, ...]:
        """The parameters that it depends on, in the order of their names."""
        both = sp.Tuple(self.expression, self.period or sp.S.Zero).free_symbols
        return tuple(sorted(both - {_START}, key=lambda symbol: str(symbol.name)))

    @derived_property
    def _functions(self) -> tuple[Callable[..., Any], Callable[..., Any]]:
        arguments = (_START, *self.symbols)
        period = sp.S.Zero if self.period is None else self.period
        return sp.lambdify(arguments, self.expression, "mpmath"), sp.lambdify(arguments, period, "mpmath")

    def value(self, start: float, parameters: Mapping[str, float]) -> float:
        """Return the value for a start [s], rounded once; NaN where there is none."""
        whole, period = self._functions
        return _rounded(whole, period, start, [parameters[symbol.name] for symbol in self.symbols])

    @deriving
    def derivative(self, name: str, start: float, parameters: Mapping[str, float]) -> float:
        """Return the derivative of the value by a parameter."""
        if name not in self._derivatives:
            (symbol,) = (s for s in self.symbols if s.name == name)
            slope = sp.diff(self.expression, symbol)
            self._derivatives[name] = sp.lambdify((_START, *self.symbols), slope, "mpmath")
        return _rounded(self._derivatives[name], None, start, [parameters[symbol.name] for symbol in self.symbols])


@deriving  # the precision of mpmath is one for all threads
def _rounded(
    function: Callable[..., Any], period: Callable[..., Any] | None, start: float, values: Iterable[float]
) -> float:
    from mpmath import mp, mpf

    given = [start, *values]
    if not all(math.isfinite(x) for x in given):
        return math.nan
    with mp.workprec(_BITS):
        exact = [mpf(x) for x in given]
        try:
            found = mpf(function(*exact))
            length = mpf(0) if period is None else mpf(period(*exact))
            if length:
                found -= length * mp.nint(found / length)
            return float(found)
        except (TypeError, ValueError, ArithmeticError):
            return math.nan


@final
class ElapsedTime:
    """Rewrites expressions; `offsets` are the parameters that this adds, by name."""

    def __init__(self) -> None:
        self.offsets: dict[str, Offset] = {START: Offset(START, _START, None)}

    def __call__(self, e: Any) -> Any:
        """Return an expression in which the symbol of time stands for the elapsed time."""
        return self._shifted(e, None)

    def _shifted(self, e: Any, period: Any) -> Any:
        if not timed(e):
            return e
        if self._polynomial(e):
            return self._split(e, period)
        if isinstance(e, sp.Derivative | sp.Sum | sp.Product | sp.Integral) and e.doit() != e:
            return self._shifted(e.doit(), period)
        if isinstance(e, sp.Piecewise):
            return self._piecewise(e)
        if isinstance(e, sp.core.relational.Relational):
            return e.func(self._shifted(e.lhs - e.rhs, None), 0)
        if isinstance(e, _PERIODIC):
            return e.func(self._shifted(e.args[0], 2 * sp.pi))
        if isinstance(e, sp.Mod) and not timed(e.args[1]):
            return e.func(self._shifted(e.args[0], e.args[1]), e.args[1])
        if isinstance(e, sp.Add):
            alone = sp.Add(*(arg for arg in e.args if self._polynomial(arg)))
            others = (self._shifted(arg, None) for arg in e.args if not self._polynomial(arg))
            return sp.Add(self._shifted(alone, period), *others)
        return e.func(*(self._shifted(arg, None) for arg in e.args))

    def _polynomial(self, e: Any) -> bool:
        time = dynamicsymbols._t
        if not isinstance(e, sp.Expr) or e.atoms(AppliedUndef) or not e.is_polynomial(time):
            return False
        return e == time or sp.degree(e, time) <= _HIGHEST

    def _split(self, e: Any, period: Any) -> Any:
        """Return a polynomial in time as one in the elapsed time: all but the highest coefficient are offsets."""
        time = dynamicsymbols._t
        terms, derivative, power = [], e, 0
        while timed(derivative):
            at_start = derivative.subs(time, _START) / sp.factorial(power)
            terms.append(self._offset(at_start, period if power == 0 else None) * time**power)
            derivative, power = sp.diff(derivative, time), power + 1
        return sp.Add(*terms, derivative / sp.factorial(power) * time**power)

    def _offset(self, expression: Any, period: Any) -> Any:
        if expression == _START and period is None:
            return self.offsets[START].symbol
        text = f"{sp.srepr(expression.subs(_START, sp.Symbol('start of t')))} {sp.srepr(sp.sympify(period or 0))}"
        name = f"time offset {hashlib.sha256(text.encode()).hexdigest()[:12]}"
        found = self.offsets.setdefault(name, Offset(name, expression, period))
        return found.symbol

    def _piecewise(self, e: Any) -> Any:
        """Return a piecewise expression; that one of its conditions holds was found before, whatever the time."""
        pairs = [(self._shifted(value, None), self._shifted(condition, None)) for value, condition in e.args]
        pairs[-1] = (pairs[-1][0], sp.true)
        return sp.Piecewise(*(ExprCondPair(*pair) for pair in pairs), evaluate=False)
