"""The plate of example 13.4.2 with Coulomb friction at the corner Q and at the ground A, by Newton and Euler.

Written out by hand in the two contact forces of each contact, with Coulomb's law as modes: slip with a sign, or stick.
The plate, of length 2 l, touches the ground at A = (x, 0) and the corner Q = (0, h): x = -h cot(theta). The force at Q
is N_Q along S.y = (-sin, cos) and F_Q along S.x = (cos, sin), that at A is N_A upwards and T_A along the ground.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple, final

import mpmath as mp

from oracles.extrapolation import follow

__all__ = ["Forces", "Plate", "Span", "history", "slip_velocity", "state_at"]


class Forces(NamedTuple):
    """Angular acceleration and contact forces."""

    alpha: Any
    N_A: Any
    T_A: Any
    N_Q: Any
    F_Q: Any


def _no_force(t):
    return mp.mpf(0)


@final
@dataclass(frozen=True)
class Plate:
    """Mass, half length, height of the corner, gravity, friction at A and Q as mpf, and the force at A over time."""

    m: Any
    l: Any
    h: Any
    g: Any
    mu_A: Any = 0
    mu_Q: Any = 0
    force: Callable[[Any], Any] = _no_force

    def sliding(self, t, theta, omega, sign, side=1) -> Forces:
        """Return the forces while x increases (sign 1) or decreases (-1), from m a = F and I alpha = M about G.

        `side` is the sign of cos(theta), and with it that of the slip along the plate, x_dot cos(theta).
        """
        m, l, h, g = self.m, self.l, self.h, self.g
        s, c = mp.sin(theta), mp.cos(theta)
        pull = self.force(t)
        ground = self.mu_A * sign  # T_A = -ground N_A
        corner = self.mu_Q * sign * side  # F_Q = -corner N_Q
        # Acceleration of G = (x + l cos, l sin), with x'' = h alpha / s^2 - 2 h omega^2 c / s^3.
        a_x, b_x = h / s**2 - l * s, -2 * h * omega**2 * c / s**3 - l * c * omega**2
        a_y, b_y = l * c, -l * s * omega**2
        up = c - corner * s  # vertical force of the corner, per N_Q
        arm = l * c + ground * l * s  # moment about G of the ground, per N_A, reversed
        # N_A = m (a_y alpha + b_y + g) - N_Q up, put into the other two equations.
        A11, A12 = m * (a_x + ground * a_y), s + corner * c - ground * up
        A21, A22 = m * l**2 / 3 + arm * m * a_y, -(h / s - l) - arm * up
        r1 = pull - m * b_x - ground * m * (b_y + g)
        r2 = l * s * pull - arm * m * (b_y + g)
        determinant = A11 * A22 - A12 * A21
        alpha = (r1 * A22 - A12 * r2) / determinant
        N_Q = (A11 * r2 - r1 * A21) / determinant
        N_A = m * (a_y * alpha + b_y + g) - N_Q * up
        return Forces(alpha, N_A, -ground * N_A, N_Q, -corner * N_Q)

    def resting(self, t, theta) -> tuple[Any, Any, Any]:
        """Return N_Q at rest, and what drives the plate against the largest friction to the right, and to the left.

        Moments about A give N_Q; along the ground F_A + T_A - N_Q sin + F_Q cos = 0 must hold for some friction
        within its cones: the first drive must be negative, the second positive.
        """
        m, l, h, g = self.m, self.l, self.h, self.g
        s, c = mp.sin(theta), mp.cos(theta)
        N_Q = m * g * l * c * s / h
        free = self.force(t) - N_Q * s
        drives = []
        for sign in (1, -1):
            ends = []
            for corner in (-self.mu_Q, self.mu_Q):
                F_Q = corner * N_Q
                ends.append(free + F_Q * c - sign * self.mu_A * (m * g - N_Q * c - F_Q * s))
            drives.append(min(ends) if sign == 1 else max(ends))
        return (N_Q, *drives)


def slip_velocity(plate: Plate, theta, omega):
    """Return the slip velocity of the plate at Q along S.x, x_dot cos(theta)."""
    return plate.h * omega * mp.cos(theta) / mp.sin(theta) ** 2


@final
@dataclass(frozen=True)
class Span:
    """A phase: "slip" or "stick", signs of x_dot and cos(theta), start and end (t, theta, omega), and what ended it."""

    mode: str
    sign: int
    side: int
    start: tuple
    end: tuple
    why: str


def _slide(plate: Plate, t, theta, omega, end, sign, side, opens) -> Span:
    def rhs(t, y):
        return [y[1], plate.sliding(t, *y, sign, side).alpha]

    events = {
        "rest": lambda t, y: sign * y[1],
        "upright": lambda t, y: side * mp.cos(y[0]),
        "N_Q": lambda t, y: plate.sliding(t, *y, sign, side).N_Q,
        "N_A": lambda t, y: plate.sliding(t, *y, sign, side).N_A,
    }
    for name in {"N_Q", "N_A"} - set(opens):
        del events[name]
    found = follow(rhs, t, [theta, omega], end, events)
    return Span("slip", sign, side, (t, theta, omega), (found.t, *found.y), found.name)


def _stick(plate: Plate, t, theta, end, side) -> Span:
    events = {
        "right": lambda t, y: -plate.resting(t, theta)[1],
        "left": lambda t, y: plate.resting(t, theta)[2],
    }
    found = follow(lambda t, y: [mp.mpf(0)], t, [0], end, events, step="0.02")
    return Span("stick", 0, side, (t, theta, mp.mpf(0)), (found.t, theta, mp.mpf(0)), found.name)


def history(plate: Plate, theta, omega, end, opens=("N_Q",)) -> Iterator[Span]:
    """Yield the phases of a motion from time 0 until `end`, or until one of the normal forces in `opens` vanishes.

    Where the plate passes the upright position its slip along the corner, x_dot cos(theta), changes its sign while x
    goes on: it cannot stick there, and a phase of slip follows another.
    """
    t, theta, omega, end = mp.mpf(0), mp.mpf(theta), mp.mpf(omega), mp.mpf(end)
    why, side = "", int(mp.sign(mp.cos(theta)))
    while t < end:
        if omega != 0 and why != "rest":
            side = -side if why == "upright" else side
            span = _slide(plate, t, theta, omega, end, int(mp.sign(omega)), side, opens)
        else:
            _, right, left = plate.resting(t, theta)
            if why not in ("right", "left") and right <= 0 <= left:
                span = _stick(plate, t, theta, end, side)
            else:
                sign = 1 if why == "right" or (why != "left" and right > 0) else -1
                span = _slide(plate, t, theta, mp.mpf(0), end, sign, side, opens)
        yield span
        (t, theta, omega), why = span.end, span.why
        if why in ("N_Q", "N_A"):
            return


def state_at(plate: Plate, spans: list[Span], t) -> tuple:
    """Return (theta, omega, forces) at a time within the phases; no forces where the plate sticks."""
    t = mp.mpf(t)
    span = next(span for span in spans if span.start[0] <= t <= span.end[0])
    t0, theta, omega = span.start
    if span.mode == "stick":
        return theta, omega, None

    def rhs(t, y):
        return [y[1], plate.sliding(t, *y, span.sign, span.side).alpha]

    theta, omega = follow(rhs, t0, [theta, omega], t).y
    return theta, omega, plate.sliding(t, theta, omega, span.sign, span.side)
