"""Random numbers and expressions as trees: numbers in the style of a scene, functions in safe domains."""

from __future__ import annotations

import random
from typing import Any

from fuzz.description import number

__all__ = ["STYLES", "Draw"]

STYLES = ("decimal", "rational", "parameter", "mixed")
PAIRS = ((3, 4, 5), (5, 12, 13), (8, 15, 17), (20, 21, 29))
T = ("t",)


class Draw:
    """Draws from one random generator; keeps the parameters that it made."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)
        self.style = STYLES[self.rng.randrange(4)]
        self.parameters: dict[str, float] = {}

    def chance(self, share: float) -> bool:
        """Return True in this share of all calls."""
        return self.rng.random() < share

    def pick(self, *choices: Any) -> Any:
        """Return one of some choices."""
        return choices[self.rng.randrange(len(choices))]

    def decimal(self, low: float, high: float) -> float:
        """Return a decimal as people write it, not zero."""
        while True:
            x = round(self.rng.uniform(low, high), self.pick(1, 2, 2, 3, 6))
            if x != 0:
                return x

    def number(self, low: float, high: float, wish: str = "c") -> Any:
        """Return a number within bounds, in the style of the scene."""
        style = self.style if self.style != "mixed" else self.pick("decimal", "rational", "parameter")
        if style == "parameter":
            return self.parameter(wish, self.decimal(low, high))
        if style == "rational":
            return self._rational(low, high)
        if self.chance(0.12):  # sums that rounding spoils: 0.1 + 0.2
            a, b = round(self.rng.uniform(low, high) / 2, 1) or 0.1, round(self.rng.uniform(low, high) / 2, 1) or 0.2
            if low <= a + b <= high and abs(a + b) > 0.05:
                return ("num", repr(a + b))
        return number(self.decimal(low, high))

    def _rational(self, low: float, high: float) -> Any:
        for _ in range(100):
            bottom = self.pick(1, 2, 3, 4, 5, 7, 10)
            top = round(self.rng.uniform(low, high) * bottom)
            if top and low <= top / bottom <= high:
                plain = number(f"{top}/{bottom}" if bottom > 1 else top)
                return plain
        return number(f"{round(self.rng.uniform(low, high) * 97) or 50}/97")

    def parameter(self, wish: str, value: float) -> Any:
        """Return a new parameter with a value."""
        name = f"{wish}_{len(self.parameters)}"
        self.parameters[name] = value
        return ("par", name)

    def axis(self, skew: float = 0.4) -> Any:
        """Return the numbers of an axis: one of three, or skew to all, in the style of the scene."""
        if not self.chance(skew):
            i = self.rng.randrange(3)
            sign = self.pick(1, 1, -1)
            return tuple(number(sign if j == i else 0) for j in range(3))
        a, b, c = self.pick(*PAIRS)
        decimals = self.style == "decimal" or (self.style == "mixed" and self.chance(0.5))
        x, y = (repr(a / c), repr(b / c)) if decimals else (f"{a}/{c}", f"{b}/{c}")
        order = [number(x), number(y), number(0)]
        if self.chance(0.4):
            order = [number(v) for v in self.pick((1, 2, 2), (2, -1, 3), (1, 1, 1), (1, 0, -2))]
            if decimals:
                order = [number(self.decimal(-1, 1)) for _ in range(3)]
        self.rng.shuffle(order)
        return tuple(order)

    def vector(self, size: float, wish: str = "a", zero: float = 0.4) -> Any:
        """Return three numbers, some of them zero."""
        return tuple(number(0) if self.chance(zero) else self.number(-size, size, wish) for _ in range(3))

    def positive(self, low: float, high: float, wish: str) -> Any:
        """Return a positive number."""
        return self.number(low, high, wish)

    # --- functions of time for prescribed motions ---

    def smooth_time(self) -> Any:
        """Return a smooth function of time, of moderate size and rate."""
        a, w = self.number(0.2, 0.9, "a"), self.number(0.5, 3, "w")
        wt = ("mul", w, T)
        return self.pick(
            ("mul", a, ("sin", wt)),
            ("mul", a, ("sin", ("add", wt, self.number(-1, 1, "ph")))),
            ("mul", a, ("cos", wt)),
            wt,
            ("mul", a, ("pow", T, number(2))),
            ("add", a, ("mul", self.number(0.1, 0.6), T), ("mul", self.number(-0.5, 0.5), ("pow", T, number(3)))),
            ("mul", a, ("tanh", wt)),
            ("mul", a, ("exp", ("neg", wt))),
            ("atan", wt),
            ("log", ("add", number(1), ("pow", wt, number(2)))),
            ("sqrt", ("add", number(1), ("pow", wt, number(2)))),
        )

    # --- loads ---

    def inner(self, variables: list[Any]) -> Any:
        """Return a smooth argument of moderate size."""
        x = self.pick(*variables)
        kind = self.rng.randrange(5)
        if kind == 0:
            return x
        if kind == 1:
            return ("mul", self.number(0.4, 2.5), x)
        if kind == 2:
            return ("add", x, self.number(-0.6, 0.6))
        if kind == 3:
            return ("sin", ("mul", self.number(0.5, 3), x))
        return ("add", ("mul", self.number(-1.5, 1.5), x), ("mul", self.number(0.3, 1.2), self.pick(*variables)))

    def smooth(self, variables: list[Any]) -> Any:
        """Return a smooth function in a safe domain."""
        x, one = self.inner(variables), number(1)
        bounded = ("mul", self.number(0.2, 0.8), ("sin", x))
        squares = ("add", one, ("pow", x, number(2)))
        return self.pick(
            x,
            ("sin", x),
            ("cos", x),
            ("tan", bounded),
            ("asin", bounded),
            ("acos", bounded),
            ("atan", x),
            ("atan2", x, self.number(0.5, 2)),
            ("atan2", self.inner(variables), squares),
            ("exp", ("neg", ("pow", x, number(2)))),
            ("exp", bounded),
            ("log", squares),
            ("sqrt", squares),
            ("pow", squares, self.pick(number("1/3"), number("0.37"), number("-3/2"), number("1.5"), number("2.0"))),
            ("pow", squares, bounded),
            ("pow", x, number(self.pick(2, 3, 3))),
            ("div", x, squares),
            ("tanh", ("mul", self.number(0.5, 6), x)),
            ("sinh", bounded),
            ("cosh", bounded),
            ("sec", bounded),
            ("cot", ("add", ("num", "1.2"), ("mul", ("num", "0.3"), ("sin", x)))),
            ("csc", ("add", ("num", "1.4"), ("mul", ("num", "0.3"), ("sin", x)))),
        )

    def nonsmooth(self, variables: list[Any]) -> Any:
        """Return a function with a kink or a jump."""
        x, level = self.inner(variables), self.number(-0.5, 0.5)
        away = ("add", x, level)
        return self.pick(
            ("abs", away),
            ("max", x, level),
            ("min", x, ("mul", number("1/2"), self.inner(variables))),
            ("max", number(0), x),
            ("piecewise", x, level, number(0), ("pow", away, number(2))),
            ("piecewise", x, level, ("neg", x), ("mul", number(2), x)),
            ("mul", away, ("abs", away)),
            ("sign", away),
            ("heaviside", away),
            ("floor", ("mul", number(2), x)),
            ("ceiling", ("mul", number(2), x)),
            ("mod", x, self.number(0.3, 0.9)),
        )

    def load(self, variables: list[Any], rates: list[Any]) -> Any:
        """Return an expression of a load, of a size of about one to ten."""
        size = self.number(-6, 6, "F")
        kind = self.rng.random()
        if kind < 0.12:
            return size
        if kind < 0.3:
            return ("mul", ("neg", self.number(0.5, 12, "k")), self.pick(*variables))
        if kind < 0.42:
            return ("mul", ("neg", self.number(0.1, 2, "d")), self.pick(*rates))
        some = [*variables, T]
        if kind < 0.55:
            return ("mul", size, self.smooth([T]))
        if kind < 0.63:
            return ("mul", size, self.nonsmooth([T]))
        if kind < 0.71:
            return ("mul", size, self.nonsmooth(some))
        if kind < 0.76:
            return ("mul", ("neg", self.number(0.1, 1)), ("tanh", ("mul", number(4), self.pick(*rates))))
        if kind < 0.88:
            return ("mul", size, self.smooth(some))
        return ("mul", size, self.smooth(some), self.smooth([*some, *rates]))

    def pulse(self, span: tuple[float, float]) -> tuple[Any, list[float]]:
        """Return a pulse of time that is short or narrow, and where the reference has to look for it."""
        t0, t1 = span
        at = round(t0 + (t1 - t0) * self.rng.uniform(0.2, 0.8), 3)
        size, kind = self.number(-9, 9, "F"), self.pick("window", "piecewise", "gauss", "square wave")
        since = ("add", T, number(repr(-at)))
        if kind == "window":
            later = ("heaviside", ("add", T, number(repr(-at - 0.03))))
            return ("mul", size, ("add", ("heaviside", since), ("neg", later))), []
        if kind == "piecewise":
            tail = ("piecewise", T, number(repr(at + 0.02)), size, number(0))
            return ("piecewise", T, number(repr(at)), number(0), tail), []
        if kind == "gauss":
            width = self.pick(0.005, 0.01)
            power = ("pow", ("div", since, number(width)), number(2))
            return ("mul", size, ("exp", ("neg", power))), [at + k * width for k in (-6, -2, 0, 2, 6)]
        return ("mul", size, ("add", number(1), ("sign", ("sin", ("mul", number(20), T))))), []
