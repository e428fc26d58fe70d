"""Reference solutions in extended precision, by Taylor series with mpmath on equations reduced by hand.

``python benchmarks/extended.py`` writes benchmarks/references.json anew (some minutes). Nothing of dalembert takes
part but the names of the cases.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import mpmath

__all__ = ["FILE", "final_state"]

FILE = Path(__file__).resolve().parent / "references.json"
DIGITS, ORDER = 34, 44


class Series:
    """A Taylor series whose coefficients are computed when first asked for."""

    def __init__(self, rule: Callable[[int], Any]) -> None:
        self._rule, self._known = rule, []

    def __getitem__(self, k: int) -> Any:
        """Return coefficient k."""
        while len(self._known) <= k:
            self._known.append(self._rule(len(self._known)))
        return self._known[k]

    def __add__(self, other: Any) -> Series:
        """Return the sum."""
        other = _series(other)
        return Series(lambda k: self[k] + other[k])

    def __sub__(self, other: Any) -> Series:
        """Return the difference."""
        other = _series(other)
        return Series(lambda k: self[k] - other[k])

    def __mul__(self, other: Any) -> Series:
        """Return the product."""
        if not isinstance(other, Series):
            return Series(lambda k: self[k] * other)
        return Series(lambda k: mpmath.fsum(self[j] * other[k - j] for j in range(k + 1)))

    def __truediv__(self, other: Any) -> Series:
        """Return the quotient."""
        if not isinstance(other, Series):
            return Series(lambda k: self[k] / other)
        quotient = Series(lambda k: (self[k] - mpmath.fsum(quotient[j] * other[k - j] for j in range(k))) / other[0])
        return quotient

    def __neg__(self) -> Series:
        """Return the negative."""
        return Series(lambda k: -self[k])

    def __rsub__(self, other: Any) -> Series:
        """Return a number less the series."""
        return _series(other) - self

    __radd__, __rmul__ = __add__, __mul__


def _series(value: Any) -> Series:
    return value if isinstance(value, Series) else Series(lambda k: mpmath.mpf(value) if k == 0 else mpmath.mpf(0))


def _sine_and_cosine() -> tuple[Callable[[Series], Series], Callable[[Series], Series]]:
    """Return sine and cosine, which share their series where they have one argument."""
    pairs: dict[int, tuple[Series, Series]] = {}

    def pair(x: Series) -> tuple[Series, Series]:
        if id(x) not in pairs:
            s = Series(lambda k: _turned(x, c, k) if k else mpmath.sin(x[0]))
            c = Series(lambda k: -_turned(x, s, k) if k else mpmath.cos(x[0]))
            pairs[id(x)] = s, c
        return pairs[id(x)]

    return (lambda x: pair(x)[0]), (lambda x: pair(x)[1])


def _turned(x: Series, other: Series, k: int) -> Any:
    return mpmath.fsum(j * x[j] * other[k - j] for j in range(1, k + 1)) / k


def final_state(rhs: Callable[..., Sequence[Any]], p: Sequence[float], start: Sequence[float], end: float) -> list[Any]:
    """Return the state at `end` of y' = rhs(y, p, (sin, cos)), to some 30 digits for regular motions."""
    with mpmath.workdps(DIGITS):
        y, t, goal = [mpmath.mpf(v) for v in start], mpmath.mpf(0), mpmath.mpf(end)
        parameters = [mpmath.mpf(v) for v in p]
        while t < goal:
            coefficients = _coefficients(rhs, parameters, y)
            largest = [max(abs(c[k]) for c in coefficients) for k in (ORDER - 1, ORDER)]
            radius = min((1 / v) ** (mpmath.mpf(1) / k) for k, v in zip((ORDER - 1, ORDER), largest, strict=True) if v)
            h = min(goal - t, radius * mpmath.mpf(10) ** (-mpmath.mpf(DIGITS) / ORDER))
            y = [mpmath.polyval(c[::-1], h) for c in coefficients]
            t += h
        return y


def _coefficients(rhs: Callable[..., Sequence[Any]], p: Sequence[Any], y: Sequence[Any]) -> list[list[Any]]:
    """Return the Taylor coefficients of the solution through y, one list a component."""
    rates: list[Series] = []
    state = [Series(lambda k, i=i: rates[i][k - 1] / k if k else y[i]) for i in range(len(y))]
    rates += [_series(rate) for rate in rhs(state, p, _sine_and_cosine())]
    return [[series[k] for k in range(ORDER + 1)] for series in state]


def main() -> None:
    """Write the references of all cases that have no closed form."""
    from batches import references as samples
    from cases import END, EXTENDED

    references = {}
    for name, (rhs, p, start) in {**EXTENDED, **samples()}.items():
        references[name] = [mpmath.nstr(v, 25) for v in final_state(rhs, p, start, END)]
        print(name, references[name][:3], flush=True)
    FILE.write_text(json.dumps(references, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
