"""Sides of switches: [state on switches] -> [state on the sides to which the motion goes].

A switch is an operation of the state with a jump or a kink: `sign`, `Heaviside`, `floor`, `Abs`, `Min`, `Max`, the
conditions of a `Piecewise`. The rates at the switch itself may be those of neither side, as sign(0) is 0. They say
whether a motion that is there rests, and which way it begins. It goes to that side if the rates there take it the same
way, else to the other side if those there take it that way. Where both sides push it back, it stays. All switches that
a state is on are decided at once, because forces at one may depend on the side of another.

At a kink nothing has to be decided. The state is moved all the same: a coordinate that rests at 1.5 stays there by
rounding for 1e-8 s, whatever moves it, and until then steps do not know the side. Rounding at 0 is not so coarse.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

from ..ir.graph import Node
from ..transforms.derivatives import GUARDED, cotangents
from .departures import Departures
from .jumps import NEAREST, Jump

__all__ = ["SwitchSides"]

_TINY = 1e-30
_CONTINUOUS = 1e-9
"""Share of a rate within which its values on two sides of a switch are equal."""
_SWEEPS = 3
"""Rounds of moves where the arguments of two switches depend on the same components of the state."""


@final
class SwitchSides:
    """Moves of a state off switches.

    Parameters
    ----------
    departures : Departures
        Derivatives along the motion.
    switches : sequence of Jump
    reach : Node
        Distance within which a state is on a switch, in margins.
    """

    def __init__(self, departures: Departures, switches: Sequence[Jump], reach: Node) -> None:
        self.departures, self.switches, self.graph, self.reach = departures, switches, departures.graph, reach
        g = self.graph
        self._slopes = [cotangents(g, [switch.argument], [g.one], departures.inputs, GUARDED) for switch in switches]
        self._derivatives = departures.derivatives([switch.argument for switch in switches])

    def left_to(self, state: Sequence[Node]) -> list[Node]:
        """Return a state, moved to the sides to which the motion goes where it is on switches."""
        g, zero = self.graph, self.graph.zero
        at = [self.departures.at([switch.argument, switch.margin], state) for switch in self.switches]
        places = [
            switch.place(g, here, self.reach * margin) for switch, (here, margin) in zip(self.switches, at, strict=True)
        ]
        margins = [margin for _, margin in at]
        gaps = [here - place for (here, _), place in zip(at, places, strict=True)]
        near = [
            g.call("less_equal", g.call("abs", gap), self.reach * margin)
            for gap, margin in zip(gaps, margins, strict=True)
        ]
        ways = self._leading(state, margins)
        begins = [
            is_near * (g.call("less", zero, way) - g.call("less", way, zero))
            for is_near, way in zip(near, ways, strict=True)
        ]
        ahead, behind = (self._moved(state, places, margins, sides) for sides in (begins, [-side for side in begins]))
        jumps, taken = g.call("max", self._jump(ahead, behind), self._jump(ahead, state)), []
        there, back = self._leading(ahead, margins), self._leading(behind, margins)
        for side, gap, margin, first, second in zip(begins, gaps, margins, there, back, strict=True):
            goes = g.call("less_equal", zero, side * first)
            turns = (1 - goes) * g.call("less", side * second, zero)
            side = side * (goes - turns) * g.call("max", jumps, g.call("less", g.const(NEAREST), margin))
            taken.append(side * g.call("less_equal", side * gap, zero))  # 0 where it is on that side already
        return self._moved(state, places, margins, taken)

    def _leading(self, state: Sequence[Node], margins: Sequence[Node]) -> list[Node]:
        """Return what has the sign of the motion of each argument from a state."""
        flat = self.departures.at([node for row in self._derivatives for node in row], state)
        rows, first = [], 0
        for row, margin in zip(self._derivatives, margins, strict=True):
            rows.append(self.departures.leading(flat[first : first + len(row)], margin))
            first += len(row)
        return rows

    def _moved(
        self, state: Sequence[Node], places: Sequence[Node], margins: Sequence[Node], sides: Sequence[Node]
    ) -> list[Node]:
        """Return a state with each argument moved a margin to a side (1 or -1) of its place, or not at all (0)."""
        g, moved = self.graph, list(state)
        for _ in range(_SWEEPS if self._overlap() else 1):
            for i, switch in enumerate(self.switches):
                here, *slopes = self.departures.at([switch.argument, *self._slopes[i]], moved)
                far = places[i] + sides[i] * margins[i] - here
                far = far / g.call("max", g.sum(slope * slope for slope in slopes), g.const(_TINY))
                moved = [
                    y if slope.is_zero else g.call("select", sides[i], y + slope * far, y)
                    for y, slope in zip(moved, slopes, strict=True)
                ]
        return moved

    def _overlap(self) -> bool:
        """Return whether two arguments depend on the same component of the state."""
        used = [{m for m, slope in enumerate(slopes) if not slope.is_zero} for slopes in self._slopes]
        return sum(map(len, used)) > len(set().union(*used))

    def _jump(self, ahead: Sequence[Node], behind: Sequence[Node]) -> Node:
        """Return 1 where rates at two states differ by more than a smooth function of the state does, else 0."""
        g, excess = self.graph, self.graph.zero
        both = (self.departures.at(self.departures.rates, state) for state in (ahead, behind))
        for a, b in zip(*both, strict=True):
            size = g.call("abs", a) + g.call("abs", b)
            excess = g.call("max", excess, g.call("abs", a - b) - g.const(_CONTINUOUS) * size)
        return g.call("less", g.zero, excess)
