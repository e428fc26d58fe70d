"""Compute the reference values of the motions with friction and contacts, into ``friction_references.json``.

Run as ``python tests/hard_cases/derive_friction.py`` (half a minute); nothing of dalembert takes part. Closed forms and
Newton-Euler equations written by hand, integrated in 32 digits, their events located to 25 (`oracles.friction_plate`,
`oracles.friction_rod`, `oracles.extrapolation`).
"""

import json
import sys
from pathlib import Path

import mpmath as mp

sys.path.insert(0, str(Path(__file__).parents[1]))
from oracles.extrapolation import follow
from oracles.friction_plate import Plate, history, state_at
from oracles.friction_rod import Rod

FILE = Path(__file__).with_name("friction_references.json")
DIGITS = 20
NEWTON = "Newton-Euler by hand, in 32 digits by extrapolation"


def text(values):
    """Return numbers as strings of 20 digits."""
    return [mp.nstr(mp.mpf(x), DIGITS) for x in values]


def entry(source, parameters, phases, rows):
    """Return an entry: parameters, starts of phases with what each contact does, rows of time and observed values."""
    return {
        "source": source,
        "parameters": {key: str(value) for key, value in parameters.items()},
        "phases": [{"t": text([t])[0], "modes": modes} for t, modes in phases],
        "rows": [{"t": text([t])[0], "state": text(state)} for t, state in rows],
    }


# -- the plate on a corner ----------------------------------------------------------------------


def _plate(p, force=None):
    values = {key: mp.mpf(p.get(key, 0)) for key in ("m", "l", "h", "g", "mu_A", "mu_Q")}
    return Plate(**values, **({} if force is None else {"force": force}))


def _rows(plate, spans, times):
    for t in times:
        theta, omega, forces = state_at(plate, spans, t)
        rest = plate.resting(mp.mpf(t), theta)[0] if forces is None else forces.N_Q
        yield t, [theta, omega, rest]


def plate_push_pull():
    """Return stick and slip under F_A = 4 + 7 sin(3 t) over 8 s: theta, theta_dot, N_Q."""
    p = {"m": 1, "l": 1, "h": "0.5", "g": "9.81", "mu_Q": "0.8"}
    plate = _plate(p, lambda t: 4 + 7 * mp.sin(3 * t))
    spans = list(history(plate, "0.5", 0, 8))
    phases = [(span.start[0], {"corner": span.mode}) for span in spans]
    return entry(NEWTON, p, phases, _rows(plate, spans, ("0.6", "2.2", "5", "8")))


def plate_upright():
    """Return theta, theta_dot, x, x_dot of a plate pushed through the upright position until the corner lets it go.

    Free of the corner, A slides on the ground: m (x'' - l s alpha - l c w^2) = F_A, N_A = m (l c alpha - l s w^2 + g),
    m l^2/3 alpha = -l c N_A + l s F_A.
    """
    p = {"m": 1, "l": 1, "h": "0.8", "g": "9.81", "mu_Q": "0.2"}
    pull = mp.mpf(4)
    plate = _plate(p, lambda t: pull)
    spans = list(history(plate, "1.3", 2, 1))
    assert [span.why for span in spans] == ["upright", "N_Q"]

    def free(t, y):
        _, theta, _, omega = y
        s, c = mp.sin(theta), mp.cos(theta)
        alpha = (-3 * c * (plate.g - s * omega**2) + 3 * s * pull) / (1 + 3 * c**2)
        return [y[2], omega, pull + s * alpha + c * omega**2, alpha]

    def full(theta, omega):
        return [-plate.h * mp.cot(theta), theta, plate.h * omega / mp.sin(theta) ** 2, omega]

    end, theta, omega = spans[-1].end
    after = follow(free, end, full(theta, omega), "0.25").y
    phases = [(span.start[0], {"corner": "slip"}) for span in spans] + [(end, {"corner": "open"})]
    first = state_at(plate, spans, "0.1")
    rows = [("0.1", full(*first[:2])), (end, full(theta, omega)), ("0.25", after)]
    return entry(NEWTON, p, phases, rows)


def plate_lifts():
    """Return where the end A leaves the ground under a constant push of 20 N: theta, theta_dot, N_Q there."""
    p = {"m": 1, "l": 1, "h": "0.8", "g": "9.81", "mu_Q": "0.2"}
    plate = _plate(p, lambda t: mp.mpf(20))
    (span,) = history(plate, 1, 0, 1, opens=("N_Q", "N_A"))
    assert span.why == "N_A"
    phases = [(0, {"corner": "slip", "ground": "closed"}), (span.end[0], {"corner": "slip", "ground": "open"})]
    rows = _rows(plate, [span], ("0.1", span.end[0]))
    return entry(NEWTON, p, phases, rows)


def plate_two_frictions(mu_A, mu_Q, end):
    """Return theta, theta_dot, N_Q of a plate with friction at both ends that slides up and stops."""
    p = {"m": 1, "l": 1, "h": "0.8", "g": "9.81", "mu_A": mu_A, "mu_Q": mu_Q}
    plate = _plate(p)
    spans = list(history(plate, "0.7", 1, end, opens=("N_Q", "N_A")))
    phases = [(span.start[0], {"corner": span.mode, "ground": span.mode}) for span in spans]
    rows = [row for row in _rows(plate, spans, ("0.1", end))]
    rows = [(t, state[:2]) for t, state in rows]
    return entry(NEWTON, p, phases, rows)


# -- the rod ------------------------------------------------------------------------------------


def rod_stops():
    """Return x, theta, x_dot, theta_dot of a rod that slides, sticks, and slips away as it falls."""
    p = {"m": 1, "l": 1, "mu": "0.5", "g": "9.81"}
    rod = Rod(*(mp.mpf(x) for x in p.values()))
    start = [mp.mpf(x) for x in ("0", "1.2", "-1", "0")]
    stop = rod.slide(start, 1)
    slip = rod.pivot(stop.y, 1, stop.t)
    assert (stop.name, slip.name) == ("stop", "slip")
    last = rod.slide(slip.y, 1, slip.t)
    modes = [(0, "slip"), (stop.t, "stick"), (slip.t, "slip")]
    rows = [("0.1", rod.slide(start, "0.1").y), ("0.5", rod.pivot(stop.y, "0.5", stop.t).y), (1, last.y)]
    return entry(NEWTON, p, [(t, {"ground": mode}) for t, mode in modes], rows)


def rod_lifts():
    """Return x, theta, x_dot, theta_dot and y of a rod that spins so fast that it leaves the ground."""
    p = {"m": 1, "l": 1, "mu": "0.5", "g": "9.81"}
    rod = Rod(*(mp.mpf(x) for x in p.values()))
    start = [mp.mpf(x) for x in ("0", "0.5", "-3", "3.5")]
    lift = rod.slide(start, 1)
    assert lift.name == "lift"
    x, theta, u, omega = lift.y
    s, c = mp.sin(theta), mp.cos(theta)
    t = mp.mpf("0.3") - lift.t
    angle = theta + omega * t
    flown = [
        x + c + (u - omega * s) * t - mp.cos(angle),
        angle,
        u - omega * s + omega * mp.sin(angle),
        omega,
        s + omega * c * t - rod.g * t * t / 2 - mp.sin(angle),
    ]
    rows = [("0.15", [*rod.slide(start, "0.15").y, 0]), ("0.3", flown)]
    return entry(NEWTON, p, [(0, {"ground": "slip"}), (lift.t, {"ground": "open"})], rows)


def rod_falls():
    """Return x, theta, x_dot, theta_dot of a rod that falls on the ground, where its end stops, slips, sticks.

    The impact is plastic. The impulses that bring A to rest, along and across the ground, lie within Coulomb's cone, so
    that A stops; the angular momentum about A stays.
    """
    p = {"m": 1, "l": 1, "mu": "0.3", "g": "9.81"}
    rod = Rod(*(mp.mpf(x) for x in p.values()))
    theta, u, height = mp.mpf(1), mp.mpf(1), mp.mpf("0.5")
    s, c = mp.sin(theta), mp.cos(theta)
    hit = mp.sqrt(2 * height / rod.g)
    v = -rod.g * hit
    omega = (c * v - s * u) * 3 / 4
    along, across = -s * omega - u, c * omega - v  # impulses over m: changes of the velocity of G
    assert abs(along) < rod.mu * across
    y = [u * hit, theta, mp.mpf(0), omega]
    assert abs(rod.sticking(theta, omega)[2]) > rod.mu * rod.sticking(theta, omega)[1]  # it cannot hold there
    first = rod.slide(y, 2, hit, step="0.002")
    stuck = rod.pivot(first.y, 2, first.t)
    second = rod.slide(stuck.y, "0.6", stuck.t)
    assert (first.name, stuck.name, second.name) == ("stop", "slip", "")
    modes = [(0, "open"), (hit, "slip"), (first.t, "stick"), (stuck.t, "slip")]
    phases = [(t, {"ground": mode}) for t, mode in modes]
    rows = [
        ("0.3", [mp.mpf("0.3"), theta, u, mp.mpf(0)]),
        ("0.4", rod.pivot(first.y, "0.4", first.t).y),
        ("0.6", second.y),
    ]
    return entry(NEWTON, p, phases, rows)


# -- closed forms -------------------------------------------------------------------------------


def belt():
    """Return x, x_dot of the block on a belt: it sticks until k x = mu_s m g, then swings about k x = mu m g."""
    p = {"m": 1, "k": 4, "mu_s": "0.5", "mu": "0.3", "g": "9.81", "v_b": "0.2"}
    m, k, mu_s, mu, g, v = (mp.mpf(x) for x in p.values())
    w, start, middle = mp.sqrt(k / m), mu_s * m * g / k, mu * m * g / k
    slip = 2 / w * (mp.pi - mp.atan(w * (start - middle) / v))
    stick = 2 * (start - middle) / v
    first = start / v
    phases = [(0, "stick")]
    while phases[-1][0] < 100:
        t = first + (len(phases) // 2) * (slip + stick) + (0 if len(phases) % 2 else -stick)
        phases.append((t, "slip" if len(phases) % 2 else "stick"))
    phases.pop()

    def state(t):
        begin, mode = [item for item in phases if item[0] <= t][-1]
        if mode == "slip":
            s = w * (t - begin)
            return [
                middle + (start - middle) * mp.cos(s) + v / w * mp.sin(s),
                v * mp.cos(s) - w * (start - middle) * mp.sin(s),
            ]
        return [v * t if begin == 0 else 2 * middle - start + v * (t - begin), v]

    rows = [(t, state(mp.mpf(t))) for t in ("5", "6.5", "7.5", "10", "20", "50", "100")]
    return entry("closed form", p, [(t, {"belt": mode}) for t, mode in phases], rows)


def coulomb_oscillator():
    """Return x of the oscillator that loses 2 mu m g / k of amplitude each half cycle until it sticks."""
    p = {"m": 1, "k": 100, "mu": "0.2", "g": "9.81"}
    m, k, mu, g = (mp.mpf(x) for x in p.values())
    w, d, a = mp.sqrt(k / m), mu * m * g / k, mp.mpf("0.5")
    phases, places = [], []
    while abs(a) > d:
        phases.append((len(phases) * mp.pi / w, "slip"))
        places.append(a)
        a = -a + 2 * d * mp.sign(a)
    phases.append((len(phases) * mp.pi / w, "stick"))
    places.append(a)

    def place(t):
        i = max(i for i, (begin, _) in enumerate(phases) if begin <= t)
        begin, mode = phases[i]
        if mode == "stick":
            return places[i]
        middle = d * mp.sign(places[i])
        return middle + (places[i] - middle) * mp.cos(w * (t - begin))

    rows = [(t, [place(mp.mpf(t))]) for t in ("0.1", "1", "2", "3", "4", "5", "100")]
    return entry("closed form", p, [(t, {"table": mode}) for t, mode in phases], rows)


def incline(mu):
    """Return x, x_dot of a block pushed up an incline: it stops, and slides back where mu < tan(alpha)."""
    p = {"m": 1, "alpha": "0.5", "g": "9.81", "mu": mu}
    _, alpha, g, f = (mp.mpf(x) for x in p.values())
    up, down = g * (mp.sin(alpha) + f * mp.cos(alpha)), g * (mp.sin(alpha) - f * mp.cos(alpha))
    stop = 3 / up
    top = 3 * stop / 2
    back = max(down, mp.mpf(0)) * (2 - stop)
    rows = [("0.2", [mp.mpf("0.6") - up / 50, 3 - up / 5]), (2, [top - back * (2 - stop) / 2, -back])]
    phases = [(0, "slip"), (stop, "slip" if down > 0 else "stick")]
    return entry("closed form", p, [(t, {"incline": mode}) for t, mode in phases], rows)


def billiard():
    """Return x, y, x_dot, y_dot and omega in space of the ball that slides until it rolls."""
    p = {"m": 1, "r": "0.03", "mu": "0.2", "g": "9.81"}
    _, r, mu, g = (mp.mpf(x) for x in p.values())
    v, w = (mp.mpf(2), mp.mpf("0.5")), (mp.mpf(20), mp.mpf(-60), mp.mpf(15))
    slip = (v[0] - r * w[1], v[1] + r * w[0])
    size = mp.hypot(*slip)
    e = [x / size for x in slip]
    roll = 2 * size / (7 * mu * g)

    def state(t):
        t, rest = min(t, roll), max(t - roll, mp.mpf(0))
        a = mu * g * t
        speed = [v[i] - a * e[i] for i in (0, 1)]
        place = [v[i] * t - a * t / 2 * e[i] + speed[i] * rest for i in (0, 1)]
        spin = [w[0] - mp.mpf(5) / 2 * a / r * e[1], w[1] + mp.mpf(5) / 2 * a / r * e[0], w[2]]
        return [*place, *speed, *spin]

    rows = [(t, state(mp.mpf(t))) for t in ("0.3", "1")]
    phases = [(0, {"table": "slip"}), (roll, {"table": "stick"})]
    return entry("closed form: the slip keeps its direction and falls by (7/2) mu g; Euler", p, phases, rows)


def bouncing():
    """Return x, y, x_dot, y_dot of a ball dropped from 1 m: impacts in closed form, those before 3 s."""
    p = {"m": 1, "e": "0.8", "g": "9.81"}
    _, e, g = (mp.mpf(x) for x in p.values())
    fall = mp.sqrt(2 / g)
    times = [fall * (1 + 2 * e * (1 - e**n) / (1 - e)) for n in range(60)]

    def state(t):
        n = max((i + 1 for i, at in enumerate(times) if at <= t), default=0)
        if not n:
            return [t, 1 - g * t * t / 2, 1, -g * t]
        up, s = g * fall * e**n, t - times[n - 1]
        return [t, up * s - g * s * s / 2, 1, up - g * s]

    phases = [(t, {"ground": "open"}) for t in (mp.mpf(0), *(t for t in times if t < 3))]
    return entry("closed form", p, phases, [(t, state(mp.mpf(t))) for t in ("0.4", "1", "2", "3")])


def main():
    """Write all entries."""
    with mp.workdps(32):
        entries = {
            "plate_push_pull": plate_push_pull(),
            "plate_upright": plate_upright(),
            "plate_lifts": plate_lifts(),
            "plate_slides_back": plate_two_frictions("0.1", "0.15", 1),
            "plate_sticks": plate_two_frictions("0.9", "0.9", 1),
            "rod_stops": rod_stops(),
            "rod_lifts": rod_lifts(),
            "rod_falls": rod_falls(),
            "belt": belt(),
            "coulomb_oscillator": coulomb_oscillator(),
            "incline_back": incline("0.3"),
            "incline_sticks": incline("0.7"),
            "billiard": billiard(),
            "bouncing": bouncing(),
        }
    FILE.write_text(json.dumps(entries, indent=1) + "\n")


if __name__ == "__main__":
    main()
