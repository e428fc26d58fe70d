"""Three mechanisms that users of other programs complained about, from an empty process to the first trajectory.

    python benchmarks/complaints.py           # prints the table
    python benchmarks/complaints.py --write   # saves it: slow_cases.csv, for docs/many_bodies_measured.md

Sixty links on a cart took SymPy 1,596 s by a user's report; a Furuta pendulum took Multibody.jl over three minutes, and
a quadrotor had not begun to move after ten. Each runs in a process of its own with no cache; seconds are those of
the processor, the least of several processes. The energy of an unforced motion at a tolerance of 1e-10 is the check.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from itertools import pairwise
from time import process_time
from typing import Any

PROCESSES = 3
Mechanism = tuple[Any, dict[Any, float], dict[Any, float], dict[str, float]]
"""Scene, parameters, start, inputs of the timed run."""


def cart() -> Mechanism:
    """Return 60 particles on rods in a row, in absolute angles, on a cart that is pushed."""
    from sympy import symbols
    from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

    import dalembert as da

    n = 60
    q, f = dynamicsymbols(f"q0:{n + 1}"), dynamicsymbols("f")
    m, l, g = symbols(f"m0:{n + 1}", positive=True), symbols(f"l0:{n}", positive=True), symbols("g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("cart", frame=N, origin=O, coordinates=q)
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_inputs(f)
    point = O.locatenew("P0", q[0] * N.x)
    scene.add_loads((point, f * N.x))
    scene.add_bodies(Particle("cart", point, m[0]))
    for i in range(n):
        frame = N.orientnew(f"A{i}", "Axis", (q[i + 1], N.z))
        point = point.locatenew(f"P{i + 1}", l[i] * frame.x)
        scene.add_bodies(Particle(f"bob{i}", point, m[i + 1]))
    values = {g: 9.81} | dict.fromkeys(m, 0.1) | dict.fromkeys(l, 0.1)
    start = {q[0]: 0.0} | {x: -1.2 for x in q[1:]} | {x.diff(): 0.0 for x in q}
    return scene, values, start, {"f": 1.0}


def furuta() -> Mechanism:
    """Return a pendulum on an arm that a motor turns."""
    from sympy import symbols
    from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

    import dalembert as da

    arm, lean, u = dynamicsymbols("arm lean u")
    m, l, r, J, g = symbols("m l r J g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    A = N.orientnew("A", "Axis", (arm, N.z))
    B = A.orientnew("B", "Axis", (-lean, A.x))
    G = O.locatenew("end", r * A.x).locatenew("G", l * B.z)
    scene = da.Scene("furuta", frame=N, origin=O, coordinates=[arm, lean])
    rod = inertia(B, m * l**2 / 3, m * l**2 / 3, 0)
    scene.add_bodies(
        RigidBody("arm", O, A, m, (inertia(A, 0, 0, J), O)),
        RigidBody("pendulum", G, B, m, (rod, G)),
    )
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_inputs(u)
    scene.add_loads((A, u * N.z))
    values = {m: 0.024, l: 0.065, r: 0.085, J: 2e-4, g: 9.81}
    return scene, values, {arm: 0.0, lean: 0.1, arm.diff(): 0.0, lean.diff(): 0.0}, {"u": 1e-4}


def quadrotor() -> Mechanism:
    """Return a quadrotor with four turning rotors, whose thrusts are inputs, and a load on a rod below."""
    from sympy import symbols
    from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

    import dalembert as da
    from dalembert.scene.orientation import free_orientation

    x, y, z, a, b, *turns = dynamicsymbols("x y z a b r0:4")
    thrusts = dynamicsymbols("T0:4")
    m, J, rotor, moment, arm, load, rod, g = symbols("m J m_r J_r l m_l l_l g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    B, C = ReferenceFrame("B"), O.locatenew("C", x * N.x + y * N.y + z * N.z)
    scene = da.Scene("quadrotor", frame=N, origin=O, coordinates=[x, y, z])
    e = free_orientation(scene, B, N)
    scene.coordinates = (*scene.coordinates, a, b, *turns)
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_bodies(RigidBody("frame", C, B, m, (inertia(B, J, J, 2 * J), C)))
    scene.add_inputs(*thrusts)
    for i, (way, turn, thrust) in enumerate(zip((B.x, B.y, -B.x, -B.y), turns, thrusts, strict=True)):
        R, P = B.orientnew(f"R{i}", "Axis", (turn, B.z)), C.locatenew(f"P{i}", arm * way)
        scene.add_bodies(RigidBody(f"rotor{i}", P, R, rotor, (inertia(R, moment, moment, 2 * moment), P)))
        scene.add_loads((P, thrust * B.z))
    F = B.orientnew("F", "Axis", (a, B.x))
    L = F.orientnew("L", "Axis", (b, F.y))
    scene.add_bodies(Particle("load", C.locatenew("Q", -rod * L.z), load))
    values = {m: 1.0, J: 0.01, rotor: 0.05, moment: 1e-4, arm: 0.2, load: 0.3, rod: 0.5, g: 9.81}
    start = {x: 0.0, y: 0.0, z: 1.0, a: 0.3, b: -0.2} | dict.fromkeys(turns, 0.0)
    start |= dict(zip(e, (1.0, 0.0, 0.0, 0.0), strict=True)) | {q.diff(): 0.0 for q in (x, y, z, *e, a, b)}
    start |= {turn.diff(): spin for turn, spin in zip(turns, (400.0, -400.0, 400.0, -400.0), strict=True)}
    return scene, values, start, {f"T{i}": 1.5 * 9.81 / 4 for i in range(4)}


COMPLAINTS: dict[str, tuple[str, Callable[[], Mechanism], str]] = {
    "cart": ("60 links on a cart", cart, "SymPy: 1,596 s"),
    "furuta": ("Furuta pendulum", furuta, "Multibody.jl: over 3 min"),
    "quadrotor": ("quadrotor with a load", quadrotor, "Multibody.jl: unfinished in 10 min"),
}
STAGES = ("import", "scene", "compilation", "first run")


def timed(name: str) -> dict[str, Any]:
    """Return the seconds of each stage of this process, of a later run, and the change of the energy."""
    times = [process_time()]
    import dalembert as da

    times.append(process_time())
    scene, values, start, inputs = COMPLAINTS[name][1]()
    times.append(process_time())
    model = da.compile_model(scene, cache=False)
    times.append(process_time())
    run = model.simulate((0.0, 1.0), start, values, inputs=inputs)
    times.append(process_time())
    if not run.success:
        raise RuntimeError(f"{name} ends with {run.status}: {run.message}")
    found: dict[str, Any] = dict(zip(STAGES, (b - a for a, b in pairwise(times)), strict=True))
    times.append(process_time())
    model.simulate((0.0, 1.0), start, values, inputs=inputs)
    found["next"] = process_time() - times[-1]
    found["coordinates"] = len(model.layout.coordinates)
    free = da.compile_model(scene, cache=False, outputs=["energy"])
    still = dict.fromkeys(inputs, 0.0)
    energy = free.simulate((0.0, 1.0), start, values, inputs=still, rtol=1e-10, atol=1e-10)["energy"]
    found["drift"] = float(abs(energy - energy[0]).max() / abs(energy[0]))
    return found


def row(name: str, found: Mapping[str, Any]) -> str:
    """Return a row of the table."""
    title, _, report = COMPLAINTS[name]
    seconds = [f"{found[stage]:.2f}" for stage in STAGES]
    total = sum(found[stage] for stage in STAGES)
    return (
        f"| {title} | {found['coordinates']} | {' | '.join(seconds)} | {total:.2f} | {1e3 * found['next']:.1f} |"
        f" {found['drift']:.0e} | {report} |"
    )


def main(*, write: bool) -> None:
    """Print the table, or save it."""
    from saved_tables import save  # here, since processes are to import everything in their own time

    heads = ", s | ".join(STAGES)
    lines = [f"| mechanism | coordinates | {heads}, s | in all, s | next run, ms | change of energy | reported |"]
    lines.append("|---|" + "--:|" * 8 + "---|")
    for name in COMPLAINTS:
        best: dict[str, Any] = {}
        for _ in range(PROCESSES):
            command = [sys.executable, __file__, "--one", name]
            found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
            if not best or sum(found[stage] for stage in STAGES) < sum(best[stage] for stage in STAGES):
                best = found
        if best["drift"] > 1e-7:
            raise RuntimeError(f"{name}: the energy changes by {best['drift']:.1g}")
        lines.append(row(name, best))
    table = "\n".join(lines)
    print(table)
    if write:
        save("slow_cases", table)


if __name__ == "__main__":
    if "--one" in sys.argv:
        print(json.dumps(timed(sys.argv[-1])))
    else:
        main(write="--write" in sys.argv)
