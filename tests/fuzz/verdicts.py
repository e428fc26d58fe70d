"""What the reference says of a scene: whether it is regular, and its motions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fuzz.description import Description
from fuzz.jets import Kinks
from fuzz.motion import Motion, breaks, integrated
from fuzz.newton_euler import Reference, Solved
from fuzz.solving import consistent_position, consistent_rates, solved

__all__ = ["Judge"]

FINE, COARSE = 1e-12, 1e-9
SINGULAR, UNCLEAR = 1e-13, 1e-7
"""Reciprocal condition of the mass matrix on the free directions: below the first it is singular, up to the second
it may be called either."""
LEFT = 1e-9
"""What a constraint may leave over."""


@dataclass(frozen=True)
class Verdict:
    """`kind` is regular, redundant, empty constraint, singular, singular start, contradictory, undefined or unclear."""

    kind: str
    detail: str = ""


class Judge:
    """The reference of a description, with the cases that its variation makes."""

    def __init__(self, description: Description) -> None:
        self.description = description
        self.reference = Reference(description)
        self.names = description.coordinates

    def parameters(self, varied: tuple[float, ...]) -> dict[str, Any]:
        """Return the parameters of all cases."""
        cases = np.ones(len(varied))
        values = {name: value * cases for name, value in self.description.parameters.items()}
        assert self.description.variation is not None
        if self.description.variation.name in values:
            values[self.description.variation.name] = np.array(varied)
        return values

    def states(self, varied: tuple[float, ...]) -> Any:
        """Return the states at the start (2 n, C)."""
        d = self.description
        assert d.variation is not None
        keys = [*d.coordinates, *(f"{name}_dot" for name in d.coordinates)]
        y = np.array([d.start[key] for key in keys])[:, None] * np.ones(len(varied))
        if d.variation.name in keys:
            y[keys.index(d.variation.name)] = varied
        return y

    @property
    def middle(self) -> tuple[float, ...]:
        """The value of the middle case."""
        assert self.description.variation is not None
        return self.description.variation.values[2:3]

    def rows_at_start(self) -> Any:
        """Return the constraint rows (m, n) at the start of the middle case."""
        y, parameters = self._single()
        return self.reference.equations(self.description.span[0], y, parameters).rows[0]

    def _single(self) -> tuple[Any, dict[str, Any]]:
        return self.states(self.middle), self.parameters(self.middle)

    @property
    def kinks(self) -> tuple[Kinks, ...]:
        """The kinks of loads and of what is prescribed."""
        return self.reference.kinks, self.reference.geometric

    @cached_property
    def start(self) -> Solved:
        """The second rates at the start of the middle case."""
        y, parameters = self._single()
        with np.errstate(all="ignore"):
            return solved(self.reference.equations(self.description.span[0], y, parameters))

    @cached_property
    def verdict(self) -> Verdict:
        """What kind of scene this is, at its start and nearby."""
        y, parameters = self._single()
        t0, n = self.description.span[0], len(self.names)
        with np.errstate(all="ignore"):
            e = self.reference.equations(t0, y, parameters)
        left = float(max(np.abs(e.positions).max(initial=0.0), np.abs(e.rates).max(initial=0.0)))
        if not np.isfinite(left) or not np.isfinite(e.forces).all():
            return Verdict("undefined", "not finite at the start")
        if left > LEFT:
            return Verdict("contradictory", f"the constraints leave {left:.1e} over")
        s, rows = self.start, e.rows.shape[1]
        empty = [i for i in range(rows) if np.abs(e.rows[0, i]).max() < 1e-12]
        rank, regular = int(s.rank[0]), float(s.regular[0])
        if self.contradictory(s):
            return Verdict("contradictory", f"second rates clash by {s.clash[0]:.1e}")
        if rank and s.gap[0] < 1e-5:
            return Verdict("unclear", f"singular value {s.gap[0]:.1e}")
        near = self._nearby(y[:n, 0], parameters)
        if near is not None and int(near[0].rank[0]) != rank and near[0].gap[0] > 1e-4:
            return Verdict("singular start", f"rank {rank}, {int(near[0].rank[0])} nearby")
        if empty and near is not None and np.abs(near[1][empty]).max() < 1e-12:
            return Verdict("empty constraint", f"constraint {empty[0]} says nothing of the motion")
        if regular < -SINGULAR:
            return Verdict("unclear", f"a body's inertia is negative about some axis: mass matrix {regular:.1e}")
        if regular < SINGULAR:
            return Verdict("singular", f"mass matrix {regular:.1e}")
        if regular < UNCLEAR:
            return Verdict("unclear", f"mass matrix {regular:.1e}")
        if rank < rows:
            return Verdict("redundant", f"rank {rank} of {rows}")
        return Verdict("regular")

    def _nearby(self, q: Any, parameters: dict[str, Any]) -> tuple[Solved, Any] | None:
        """Return second rates and constraint rows (m, n) at a consistent state near the start, None without one."""
        t, rng = self.description.span[0], np.random.default_rng(self.description.seed)
        with np.errstate(all="ignore"):
            along, _ = consistent_rates(self.reference, t, q, rng.uniform(-1, 1, len(q)), parameters)
            there, left = consistent_position(self.reference, t, q + 0.02 * along, parameters, least=1e-3)
            u, rates = consistent_rates(self.reference, t, there, rng.uniform(-1, 1, len(q)), parameters)
            if not left + rates < LEFT:
                return None
            e = self.reference.equations(t, np.concatenate([there, u])[:, None], parameters)
            return solved(e), e.rows[0]

    @cached_property
    def times(self) -> Any:
        """The times of comparison (4,)."""
        return np.linspace(*self.description.span, 4)

    @cached_property
    def stops(self) -> list[float]:
        """Times within the span at which the reference begins a new step."""
        return self._stops(self._varied)

    def _stops(self, varied: tuple[float, ...]) -> list[float]:
        found = breaks(self.kinks, self.description.span, self.parameters(varied))
        t0, t1 = self.description.span
        return sorted({*found, *(t for t in self.description.stops if t0 < t < t1)})

    @property
    def _varied(self) -> tuple[float, ...]:
        assert self.description.variation is not None
        return self.description.variation.values

    def _motion(self, rtol: float, varied: tuple[float, ...]) -> Motion:
        states, stops = self.states(varied), self._stops(varied)
        return integrated(self.reference, states, self.parameters(varied), self.times, stops, rtol=rtol)

    @cached_property
    def motion(self) -> Motion:
        """The motions of all cases (4, 2 n, 5)."""
        return self._motion(FINE, self._varied)

    @property
    def quotient(self) -> Any:
        """The central difference quotients (2 n,) of the states at the end by what is varied."""
        low, high = self.motion.y[-1, :, 1], self.motion.y[-1, :, 3]
        return (high - low) / (self._varied[3] - self._varied[1])

    @cached_property
    def derivative(self) -> tuple[Any, float]:
        """The derivatives (2 n,) of the states at the end, and how far they may be off, of the largest, one at least.

        What rounding leaves in the states is divided by the width of a difference, so that narrow ones are off where
        the motion is ill conditioned. Differences of doubled widths are extrapolated, and of those the two next to
        each other that agree best count.
        """
        width, most = self._varied[3] - self._varied[2], self._varied[4] - self._varied[2]
        widths = [width * 2.0**k for k in range(int(np.log2(most / width)) + 1)]
        motion = self._motion(FINE, tuple(self.middle[0] + side * h for h in widths for side in (-1, 1)))
        if motion.failed:
            return self.quotient, self.uncertainty
        y = motion.y[-1]
        quotients = (y[:, 1::2] - y[:, ::2]) / (2.0 * np.array(widths))
        better = (4.0 * quotients[:, :-1] - quotients[:, 1:]) / 3.0
        apart = np.abs(np.diff(better)).max(axis=0)
        best = int(np.argmin(apart))
        return better[:, best], float(apart[best]) / max(1.0, float(np.abs(better[:, best]).max()))

    @cached_property
    def uncertainty(self) -> float:
        """The difference to the motions at a thousand times the tolerance, relative to the size of the states."""
        other = self._motion(COARSE, self._varied)
        if self.motion.failed or other.failed:
            return np.inf
        return float(np.max(np.abs(other.y - self.motion.y) / self.sizes))

    @cached_property
    def sizes(self) -> Any:
        """What errors are taken relative to: the size of each component in any case, one at least (2 n, 1)."""
        return np.maximum(1.0, np.abs(self.motion.y).max(axis=(0, 2)))[:, None]

    def smallest_gap(self, times: Any, states: Any) -> float:
        """Return the smallest singular value that counts at times (k,) and states (k, 2 n) of the middle case."""
        _, parameters = self._single()
        pairs = zip(times, states, strict=True)
        return min(float(solved(self.reference.equations(float(t), y[:, None], parameters)).gap[0]) for t, y in pairs)

    def contradictory(self, found: Solved) -> bool:
        """Whether no second rates of the middle case obey all constraints, as off a motion that cannot go on."""
        return float(found.clash[0]) > 1e-7 * max(1.0, float(found.scale[0]))

    def solved_along(self) -> list[tuple[float, Any, Solved]]:
        """Return (time, state (2 n,), second rates) of the middle case at the times of comparison."""
        _, parameters = self._single()
        found = []
        for t, y in zip(self.times, self.motion.y[:, :, 2], strict=True):
            e = self.reference.equations(float(t), y[:, None], parameters)
            found.append((float(t), y, solved(e)))
        return found
