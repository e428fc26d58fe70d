"""Compute reference values of published benchmarks in 25 digits, into ``published_references.json``.

Run as ``python tests/hard_cases/derive_published.py``; nothing of dalembert takes part. The entries of the test set
for IVP solvers are published numbers, which stay as they are.
"""

import json
from pathlib import Path

import mpmath as mp

FILE = Path(__file__).with_name("published_references.json")
GRAVITY = "9.81"
AXES = "yzxyz"
RODS = ((1, 0, 0), (0, -1, 0), (0, 0, 1), (-1, 0, 0), (0, 1, 0))


def text(values):
    """Return numbers as strings of 20 digits."""
    return [mp.nstr(x, 20) for x in values]


def _cross(a, b):
    return mp.matrix([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _turned(axis, angle):
    """Return the rotation about a coordinate axis."""
    k = "xyz".index(axis)
    i, j = (k + 1) % 3, (k + 2) % 3
    found = mp.eye(3)
    found[i, i] = found[j, j] = mp.cos(angle)
    found[j, i] = mp.sin(angle)
    found[i, j] = -found[j, i]
    return found


class Bricard:
    """Bricard's mechanism as a motion of the angle of its first joint."""

    def __init__(self):
        self.known = {mp.mpf(0): [mp.mpf(0)] * 5}
        for i in range(1, 64):
            angle = mp.mpf(i) / 20
            self.known[angle] = self.closed(angle, self.known[mp.mpf(i - 1) / 20])[0]
        self.height = self.at(mp.mpf(0))[1]

    def chain(self, q):
        """Return axes and places of the joints, orientations, centres and ends of the rods."""
        turn, place, parts = mp.eye(3), mp.matrix(3, 1), []
        for axis, angle, rod in zip(AXES, q, RODS, strict=True):
            about, joint = turn[:, "xyz".index(axis)], place
            turn = turn * _turned(axis, angle)
            arm = turn * mp.matrix(rod)
            place = joint + arm
            parts.append((about, joint, turn, joint + arm / 2, place))
        return parts

    def closed(self, first, guess):
        """Return the angles that close the chain, and the derivatives by the first, from a guess."""
        q = [first, *guess[1:]]
        for _ in range(40):
            parts = self.chain(q)
            _, _, turn, _, end = parts[4]
            left = mp.matrix([end[0], end[1], end[2] - 1, turn[1, 0], turn[2, 0]])
            slopes = mp.matrix(5, 5)
            for i, (about, joint, *_) in enumerate(parts):
                moved, turned = _cross(about, end - joint), _cross(about, turn[:, 0])
                for row, value in enumerate((moved[0], moved[1], moved[2], turned[1], turned[2])):
                    slopes[row, i] = value
            step = mp.lu_solve(slopes[:, 1:5], -left)  # least squares: one of five conditions is redundant
            q = [first, *(a + b for a, b in zip(q[1:], step, strict=True))]
            if mp.norm(step) < mp.mpf(10) ** (4 - mp.mp.dps):
                return q, [mp.mpf(1), *mp.lu_solve(slopes[:, 1:5], -slopes[:, 0])]
        raise ValueError(f"the chain does not close at {first}")

    def at(self, first):
        """Return twice the kinetic energy at unit rate, the potential energy, and the end of the second rod."""
        q, rates = self.closed(first, self.known[min(self.known, key=lambda x: abs(x - first))])
        width = mp.mpf(1) / 10
        along, across = width**2 / 6, (1 + width**2) / 12
        parts, kinetic, potential = self.chain(q), mp.mpf(0), mp.mpf(0)
        for b, (_, _, turn, centre, _) in enumerate(parts):
            spin, speed = mp.matrix(3, 1), mp.matrix(3, 1)
            for (about, joint, *_), rate in zip(parts[: b + 1], rates, strict=False):
                spin += about * rate
                speed += _cross(about, centre - joint) * rate
            own = turn.T * spin
            moments = [along if d else across for d in RODS[b]]
            kinetic += mp.fsum(moment * w**2 for moment, w in zip(moments, own, strict=True)) + mp.fsum(
                x**2 for x in speed
            )
            potential += mp.mpf(GRAVITY) * centre[1]
        return kinetic, potential, parts[1][4]

    def rate(self, first):
        """Return the rate of the first angle, from rest at zero."""
        kinetic, potential, _ = self.at(first)
        return mp.sqrt(2 * (self.height - potential) / kinetic)

    def duration(self, way, start, sense):
        """Return the time for a way from a position of rest; the variable is its root."""
        roots = mp.linspace(0, mp.sqrt(way), 6)
        return mp.quad(lambda s: 2 * s / self.rate(start + sense * s * s), roots, method="gauss-legendre", maxdegree=5)


def bricard():
    """Return the motion of Bricard's mechanism from rest: angle from energy, time by quadrature.

    It rests again where the first angle is pi and goes back.
    """
    mechanism = Bricard()
    there = mechanism.duration(mp.pi / 2, mp.mpf(0), 1) + mechanism.duration(mp.pi / 2, mp.pi, -1)

    def time(angle):
        if angle < mp.pi / 2:
            return mechanism.duration(angle, mp.mpf(0), 1)
        return there - mechanism.duration(mp.pi - angle, mp.pi, -1)

    rows = []
    for t, guess in (("1", "1.035"), ("4", "1.018"), ("10", "2.69e-4")):
        since = mp.mpf(t) % (2 * there)
        sense = 1 if since <= there else -1
        since = min(since, 2 * there - since)
        angle = mp.mpf(guess)
        for _ in range(6):
            angle -= (time(angle) - since) * mechanism.rate(angle)
        rows.append({"t": t, "state": text([*mechanism.at(angle)[2], angle, sense * mechanism.rate(angle)])})
    source = "IFToMM multibody benchmark A04; energy, and time by quadrature in 25 digits"
    return {"source": source, "period": mp.nstr(2 * there, 20), "values": rows}


def forty_windows():
    """Return the motion of forty windows: all cranks turn by one angle, and all couplers stay level."""
    count = 40
    inertia, moment = mp.mpf(count + 1) / 3 + count, mp.mpf(count + 1) / 2 + count
    k = mp.mpf(GRAVITY) * moment / inertia

    def rate(phi):
        return mp.sqrt(1 + 2 * k * (1 - mp.cos(phi)))

    def time(phi):
        return mp.quad(lambda x: 1 / rate(x), mp.linspace(0, phi, 24), method="gauss-legendre")

    rows = []
    for t, guess in (("0.5", "0.8"), ("0.7", "1.5"), ("1", "3.3"), ("4", "12.636")):
        phi = mp.findroot(lambda x, t=t: time(x) - mp.mpf(t), mp.mpf(guess), tol=1e-44)
        rows.append(
            {"t": t, "state": text([mp.sin(phi), mp.cos(phi), rate(phi) * mp.cos(phi), -rate(phi) * mp.sin(phi)])}
        )
    source = "IFToMM multibody benchmark A02; energy, and time by quadrature in 25 digits"
    return {"source": source, "values": rows}


def spring_linkage():
    """Return the eigenvalues of four equal bars with a diagonal spring at the equilibrium of their angle.

    The cranks stay parallel. With d = 2 cos(phi/2) the energy is 2 g sin(phi) + k (d - sqrt(2))^2 / 2, the moment of
    inertia 5/3, and the damper takes c (d' phi_dot)^2.
    """
    k, c, g = mp.mpf(25), mp.mpf(1), mp.mpf(GRAVITY)

    def slope(phi):
        return 2 * g * mp.cos(phi) - k * (2 * mp.cos(phi / 2) - mp.sqrt(2)) * mp.sin(phi / 2)

    phi = mp.findroot(slope, mp.mpf("2.2"))
    s, h = mp.sin(phi / 2), mp.cos(phi / 2)
    stiffness = -2 * g * mp.sin(phi) + k * (s**2 - (2 * h - mp.sqrt(2)) * h / 2)
    inertia = mp.mpf(5) / 3
    damping = c * s**2
    real, imaginary = -damping / (2 * inertia), mp.sqrt(stiffness / inertia - (damping / (2 * inertia)) ** 2)
    return {
        "source": "IFToMM multibody benchmark, four-bar linkage with diagonal spring; eigenvalues in closed form",
        "published_equilibrium": "2.23433101898",
        "published_in": "BPMinaker/eom_pkg, inst/data/input/examples/input_ex_four_bar.m",
        "values": {"phi": mp.nstr(phi, 20), "real": mp.nstr(real, 20), "imaginary": mp.nstr(imaginary, 20)},
    }


CRANK = {
    "source": "Test Set for IVP Solvers, problem crank, as in the R package deTestSet (Ex_crank.f, ex_crank.R)",
    "parameters": {
        "M2": "0.151104",
        "M3": "0.075552",
        "L1": "0.15",
        "L2": "0.30",
        "J1": "0.002727",
        "J2": "0.0045339259",
        "EE": "0.20e12",
        "BB": "0.0080",
        "HH": "0.0080",
        "RHO": "7870",
        "OMEGA": "150",
    },
    "initial": [
        *["0", "0", "0.450016933", "0", "0", "0.103339863e-4", "0.169327969e-4"],
        *["150", "-74.9957670", "-0.268938672e-5", "0.444896105", "0.463434311e-2", "-0.178591076e-5"],
        "-0.268938672e-5",
    ],
    "values": [
        *["15.00000000000104", "-0.3311734988256260", "0.1697373328427860", "0.1893192899613509e-3"],
        *["0.2375751249879174e-4", "-0.5323896770569702e-5", "-0.8363313279112129e-5"],
        *["150", "60.25346755138369", "-8.753116326670527", "-0.03005541400289738", "-0.005500431812571696"],
        *["0.4974111734266989e-3", "0.001105560003626645"],
    ],
}


def main():
    """Write all entries."""
    with mp.workdps(25):
        entries = {
            "iftomm_A04_bricard": bricard(),
            "iftomm_A02_forty_windows": forty_windows(),
            "iftomm_four_bar_with_spring": spring_linkage(),
            "ivp_test_set_crank": CRANK,
        }
    FILE.write_text(json.dumps(entries, indent=1) + "\n")


if __name__ == "__main__":
    main()
