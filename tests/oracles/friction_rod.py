"""A rod whose end A slides on rough ground, by Newton and Euler (Painleve's example)."""

from dataclasses import dataclass
from typing import Any, final

import mpmath as mp

from oracles.extrapolation import Occurrence, follow

__all__ = ["Rod"]


@final
@dataclass(frozen=True)
class Rod:
    """Parameters as mpf: mass, half length, friction, gravity. The state is (x_A, theta, x_A', theta')."""

    m: Any
    l: Any
    mu: Any
    g: Any

    def contact(self, theta, omega, sign) -> tuple[Any, Any]:
        """Return p, b in y_A'' = p N + b while A slides with x_A' of a sign, F = -sign mu N.

        m x_G'' = F, m y_G'' = N - m g, (m l^2/3) theta'' = -l cos N + l sin F, and y_A = y_G - l sin(theta).
        """
        s, c = mp.sin(theta), mp.cos(theta)
        p = (1 + 3 * c * (c + sign * self.mu * s)) / self.m
        return p, self.l * omega**2 * s - self.g

    def sliding(self, y, sign) -> tuple[list, Any]:
        """Return the rates of the state while A slides on the ground, and the normal force."""
        _, theta, u, omega = y
        s, c = mp.sin(theta), mp.cos(theta)
        p, b = self.contact(theta, omega, sign)
        N = -b / p
        F = -sign * self.mu * N
        alpha = 3 * (-c * N + s * F) / (self.m * self.l)
        return [u, omega, F / self.m + self.l * s * alpha + self.l * c * omega**2, alpha], N

    def sticking(self, theta, omega) -> tuple[Any, Any, Any]:
        """Return theta'', N, F of a rod that turns about A."""
        s, c = mp.sin(theta), mp.cos(theta)
        alpha = -3 * self.g * c / (4 * self.l)
        N = self.m * (self.g + self.l * (c * alpha - s * omega**2))
        return alpha, N, self.m * self.l * (-s * alpha - c * omega**2)

    def slide(self, y, end, t=0, step="0.05") -> Occurrence:
        """Follow the rod until A stops ("stop"), leaves the ground ("lift"), or p or theta falls to zero.

        A slip that starts from rest has to last for more than one `step`.
        """
        sign = int(mp.sign(y[2])) if y[2] else int(mp.sign(self.sticking(y[1], y[3])[2])) * -1
        events = {
            "stop": lambda t, y: sign * y[2],
            "lift": lambda t, y: self.sliding(y, sign)[1],
            "singular": lambda t, y: self.contact(y[1], y[3], sign)[0],
            "down": lambda t, y: mp.sin(y[1]),
        }
        return follow(lambda t, y: self.sliding(y, sign)[0], t, y, end, events, step=step)

    def pivot(self, y, end, t=0) -> Occurrence:
        """Follow the rod about A until Coulomb's law lets A "slip", or it lifts off or lies down."""
        x, theta, _, omega = y

        def margin(t, y):
            _, N, F = self.sticking(*y)
            return self.mu * N - abs(F)

        events = {"slip": margin, "lift": lambda t, y: self.sticking(*y)[1], "down": lambda t, y: mp.sin(y[0])}
        found = follow(lambda t, y: [y[1], self.sticking(*y)[0]], t, [theta, omega], end, events)
        return Occurrence(found.name, found.t, [mp.mpf(x), found.y[0], mp.mpf(0), found.y[1]])
