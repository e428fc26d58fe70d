"""Compute the reference values that are not from the literature, in 30 digits, into ``references.json``.

Run as ``python tests/hard_cases/derive_references.py``; nothing of dalembert takes part.
"""

import json
from pathlib import Path

import mpmath as mp

FILE = Path(__file__).with_name("references.json")
DIGITS = 20


def text(values):
    """Return numbers as strings of 20 digits."""
    return [mp.nstr(x, DIGITS) for x in values]


def edge_plate():
    """Return the fall of the edge plate from rest: theta_dot from energy, time and psi by quadrature.

    With psi_dot (B sin^2 + C cos^2) = -F theta_dot sin (equation (5) of example 13.4.4, from rest) the energy is
    theta_dot^2 K(theta) / 2 + m g h sin(theta), K = A + m h^2 cos^2 - F^2 sin^2 / (B sin^2 + C cos^2).
    """
    p = {"m": "1.3", "A": "0.2", "B": "0.35", "C": "0.55", "F": "0.08", "h": "0.4", "g": "9.81"}
    m, A, B, C, F, h, g = (mp.mpf(p[key]) for key in ("m", "A", "B", "C", "F", "h", "g"))
    top = mp.mpf(1.2)

    def about(th):
        return B * mp.sin(th) ** 2 + C * mp.cos(th) ** 2

    def inertia(th):
        return A + m * h**2 * mp.cos(th) ** 2 - F**2 * mp.sin(th) ** 2 / about(th)

    def rate(th):
        return -mp.sqrt(2 * m * g * h * (mp.sin(top) - mp.sin(th)) / inertia(th))

    def slowness(s):
        """Return dt/ds where theta = top - s^2, which takes the root at the start away."""
        th = top - s * s
        return 2 * mp.sqrt(inertia(th) / (2 * m * g * h * mp.cos((top + th) / 2) * mp.sinc(s * s / 2)))

    def time(th):
        return mp.quad(slowness, mp.linspace(0, mp.sqrt(top - th), 9), method="gauss-legendre")

    def turn(th):
        return -F * mp.sin(th) / about(th)

    rows = []
    for end in (mp.mpf("0.6"), mp.mpf(0)):
        t = float(time(end))
        th = mp.findroot(lambda x, t=t: time(x) - t, end + mp.mpf("1e-8"), tol=1e-50)
        psi = mp.mpf(0.3) + mp.quad(turn, mp.linspace(top, th, 9))
        rows.append({"t": repr(t), "state": text([th, rate(th), psi, turn(th) * rate(th), h * mp.sin(th)])})
    source = "energy and the first integral of example 13.4.4, by quadrature in 30 digits"
    return {"source": source, "values": {"parameters": p, "rows": rows}}


def slider_crank():
    """Return the free motion of a rigid slider-crank: angle of the crank from energy, time by quadrature.

    Crank r with moment J about its axis and mass centre there, rod l of mass m2 and central moment I2 with its
    centre in the middle, slider m3 along x, gravity along -y.
    """
    p = {"r": "0.15", "l": "0.4", "J": "0.003", "m2": "0.5", "I2": "0.007", "m3": "0.8", "g": "9.81"}
    r, l, J, m2, I2, m3, g = (mp.mpf(p[key]) for key in ("r", "l", "J", "m2", "I2", "m3", "g"))
    start, spin = mp.mpf(0.3), mp.mpf(12)

    def parts(phi):
        sb = r * mp.sin(phi) / l
        cb = mp.sqrt(1 - sb * sb)
        slope = r * mp.cos(phi) / (l * cb)  # d beta / d phi
        slider = -r * mp.sin(phi) - l * sb * slope
        gx = -r * mp.sin(phi) - l / 2 * sb * slope
        gy = r * mp.cos(phi) / 2
        inertia = J + m2 * (gx**2 + gy**2) + I2 * slope**2 + m3 * slider**2
        return inertia, m2 * g * r * mp.sin(phi) / 2, mp.asin(sb), slope, r * mp.cos(phi) + l * cb, slider

    first = parts(start)
    energy = first[0] * spin**2 / 2 + first[1]

    def rate(phi):
        inertia, potential = parts(phi)[:2]
        return mp.sqrt(2 * (energy - potential) / inertia)

    def time(phi):
        pieces = int(abs(phi - start) * 4) + 2
        return mp.quad(lambda x: 1 / rate(x), mp.linspace(start, phi, pieces))

    rows = []
    guess = start
    for t in (0.1, 1.0, 5.0):
        guess = mp.findroot(
            lambda phi, t=t: time(phi) - mp.mpf(t), (guess + spin * t, guess + 11 * t + 0.01), tol=1e-26
        )
        _, _, beta, slope, slider, speed = parts(guess)
        w = rate(guess)
        rows.append({"t": repr(t), "state": text([guess, beta, slider, w, slope * w, speed * w])})
    source = "energy, and time by quadrature in 30 digits"
    return {"source": source, "values": {"parameters": p, "rows": rows}}


def four_bar():
    """Return the first half second of IFToMM A02 with two windows: phi'' = 7/6 g sin(phi), upright, phi' = 1."""
    k = mp.mpf("9.81") * 7 / 6

    def rate(phi):
        return mp.sqrt(1 + 2 * k * (1 - mp.cos(phi)))

    def time(phi):
        return mp.quad(lambda x: 1 / rate(x), mp.linspace(0, phi, 9), method="gauss-legendre")

    rows = []
    for t in (0.3, 0.5):
        phi = mp.findroot(lambda x, t=t: time(x) - mp.mpf(t), mp.sinh(mp.sqrt(k) * t) / mp.sqrt(k), tol=1e-50)
        x, y = mp.sin(phi), mp.cos(phi)
        rows.append({"t": repr(t), "state": text([x, y, rate(phi) * y, -rate(phi) * x])})
    return {"source": "energy, and time by quadrature in 30 digits", "values": rows}


def upright_top():
    """Return quaternion and cos(theta) of the heavy top A = 1/2, C = 1/5, m g l = 2 from upright with w = (1, 0, 3).

    s = 1 - cos(theta) obeys s'^2 = s (2 w1^2 + (2 beta - w1^2 - a^2) s - beta s^2), a = C w3/A, beta = 2 m g l/A, and
    goes between 0 and the positive root as the square of a cn; phi' = a / (1 + cos(theta)) turns about the vertical,
    psi' = w3 - phi' cos(theta) about the axis.
    """
    A, C, weight, w1, w3 = mp.mpf(1) / 2, mp.mpf(1) / 5, mp.mpf(2), mp.mpf(1), mp.mpf(3)
    a, beta = C * w3 / A, 2 * weight / A
    middle = 2 * beta - w1**2 - a**2
    root = mp.sqrt(middle**2 + 8 * beta * w1**2)
    high, low = (middle + root) / (2 * beta), (middle - root) / (2 * beta)
    rate, m = mp.sqrt(beta * (high - low)) / 2, high / (high - low)
    quarter = mp.ellipk(m)

    def half_sine(t):
        """Return sin(theta/2), whose sign changes where the axis passes the vertical."""
        return mp.sqrt(high / 2) * mp.ellipfun("cn", rate * t - quarter, m=m)

    def precession(t):
        return a / (2 - 2 * half_sine(t) ** 2)

    rows = []
    for t in ("0.5", "1", "5", "20"):
        end = mp.mpf(t)
        pieces = mp.linspace(0, end, 2 + 2 * int(end))
        turned = mp.quad(precession, pieces)
        proper = w3 * end - mp.quad(lambda x: precession(x) * (1 - 2 * half_sine(x) ** 2), pieces)
        s = half_sine(end)
        c, plus, minus = mp.sqrt(1 - s**2), (turned + proper) / 2, (turned - proper) / 2
        state = [c * mp.cos(plus), s * mp.cos(minus), s * mp.sin(minus), c * mp.sin(plus), 1 - 2 * s**2]
        rows.append({"t": t, "state": text(state)})
    return {"source": "Jacobi's elliptic functions, and angles by quadrature, in 30 digits", "values": rows}


def spring_pendulum():
    """Return the motion of the spring pendulum by Taylor series of order 36."""
    k, l, g = mp.mpf(10) ** 6, mp.mpf(1), mp.mpf("9.81")
    order, state, t = 36, [mp.mpf(1), mp.mpf(0), mp.mpf(0), mp.mpf(0)], mp.mpf(0)
    rows = []
    for end in (0.1, 1.0):
        count = int(mp.ceil((mp.mpf(end) - t) * 500))
        step = (mp.mpf(end) - t) / count
        for _ in range(count):
            state = [mp.polyval(series[::-1], step) for series in _series(state, k, l, g, order)]
        t = mp.mpf(end)
        rows.append({"t": repr(end), "state": text(state)})
    return {"source": "Taylor series of order 36 in 30 digits, steps of 2 ms and 1 ms agree", "values": rows}


def _series(state, k, l, g, order):
    """Return the series of x, y, x_dot, y_dot with x'' = -k x (1 - l / rho), y'' the same with -g; mass 1."""
    x, y, u, v = ([value] for value in state)
    square, rho, inverse = [], [], []
    for n in range(order):
        square.append(mp.fsum(x[i] * x[n - i] + y[i] * y[n - i] for i in range(n + 1)))
        if n == 0:
            rho.append(mp.sqrt(square[0]))
            inverse.append(1 / rho[0])
        else:
            rho.append((square[n] - mp.fsum(rho[i] * rho[n - i] for i in range(1, n))) / (2 * rho[0]))
            inverse.append(-mp.fsum(rho[i] * inverse[n - i] for i in range(1, n + 1)) / rho[0])
        pull = [k * (l * mp.fsum(z[i] * inverse[n - i] for i in range(n + 1)) - z[n]) for z in (x, y)]
        for series, rate in ((x, u[n]), (y, v[n]), (u, pull[0]), (v, pull[1] - (g if n == 0 else 0))):
            series.append(rate / (n + 1))
    return x, y, u, v


def main():
    """Replace the derived entries."""
    entries = json.loads(FILE.read_text())
    with mp.workdps(30):
        entries |= {
            "edge_plate_flat": edge_plate(),
            "slider_crank": slider_crank(),
            "stiff_spring_pendulum": spring_pendulum(),
            "four_bar_start": four_bar(),
            "heavy_top_upright": upright_top(),
        }
    FILE.write_text(json.dumps(entries, indent=1) + "\n")


if __name__ == "__main__":
    main()
