"""Write docs/examples/*.md: the worked examples of section 13.4, each derived by running the code.

Run it from the repository's root: ``python docs/generate_examples.py``; ``--check`` only tells whether the pages are as
the code would write them.
"""

from __future__ import annotations

import argparse
import inspect
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path

import numpy as np
import sympy as sp
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from dalembert.scene.frames import Tree
from dalembert.textbook import lagrange_operator
from dalembert.textbook.printing import latex

FOLDER = Path(__file__).parent / "examples"
TIME = dynamicsymbols._t
SLIP = r"\mathbf{v}_{Q \in 1/0}"
RELEASE_Y = """
y = dynamicsymbols("y")
view = da.lagrange(scene.release(y, A, N.y))
view.equation(y)
"""
RELEASE_Z = """
z = dynamicsymbols("z")
view = da.lagrange(scene.release(z, G, N.z))
view.equation(z)
"""
FRICTION = """
scene.add_friction(da.CoulombFriction(N_Q, F_Q, mu=mu, name="corner"))
"""
LONGEST = 600
"""Characters of a displayed equation whose right-hand side is shown."""
BANNER = "<!-- Written by docs/generate_examples.py; do not edit. -->\n"


def point(scene: da.Scene, name: str) -> sp.Basic:
    """Return a point of a scene by its name."""
    return next(p for p in Tree(scene.origin, "_pos_dict").parent if p.name == name)


def frame(scene: da.Scene, name: str) -> sp.Basic:
    """Return a frame of a scene by its name."""
    return next(f for f in Tree(scene.frame, "_dcm_dict").parent if f.name == name)


def code(text: str) -> str:
    """Return a block of Python code."""
    return f"```python\n{textwrap.dedent(text).strip()}\n```\n"


def scene_code(build: Callable[[], da.Scene]) -> str:
    """Return the lines in which a ready scene is written, without its docstring."""
    source = textwrap.dedent(inspect.getsource(build))
    body = source.split('"""', 2)[2] if '"""' in source else source
    body = body.partition("    if friction:")[0]
    return code(body.replace("    return scene\n", ""))


def show(left: str, right: object) -> str:
    """Return a displayed equation."""
    return f"$${left} = {latex(right)}$$\n"


def equations(view: da.LagrangeView, *coordinates: object) -> str:
    """Return the Lagrange equations of some coordinates."""
    return "\n".join(f"$${latex(view.equation(q))}$$\n" for q in coordinates)


def derivation(view: da.LagrangeView, build: Callable[[], da.Scene]) -> str:
    """Return the code of a scene and its whole derivation."""
    first = f"import dalembert as da\n\nview = da.lagrange(da.scenes.{build.__name__}())\nview.report()"
    lines = view.report().markdown().split("\n")
    long = [line for line in lines if len(line) > LONGEST]
    note = "Right-hand sides that are dots are long: ``view.reactions`` and ``view.equations_of_motion`` have them.\n\n"
    shown = "\n".join(line.split(" = ")[0] + r" = \ldots$$" if line in long else line for line in lines)
    return f"{scene_code(build)}\n{code(first)}\n{note if long else ''}{shown}"


def friction_table() -> str:
    """Return what the plate does with friction: how it goes on, when it stops, and where."""
    scene = da.scenes.corner_plate()
    N_Q, F_Q = da.unknowns("N_Q F_Q")
    scene.add_friction(da.CoulombFriction(N_Q, F_Q, mu=sp.Symbol("mu"), name="corner"))
    model = da.compile_model(scene, backend="numpy")
    start = {"x": -0.5 / np.tan(0.6), "theta": 0.6, "theta_dot": 1.0}
    rows = [
        "| mu | stops at t | at theta | tan(theta) | then | theta at 1 s |",
        "| ---: | ---: | ---: | ---: | --- | ---: |",
    ]
    for mu in (0.2, 0.5, 0.8):
        p = {"m": 1, "l": 1, "h": 0.5, "g": 9.81, "F_A": 0, "mu": mu}
        run = model.simulate((0, 1), start, p, rtol=1e-11, atol=1e-13)
        (then,) = (phase for phase in run.phases[1:])
        angle = run([then.t0])["theta"][0]
        does = "sticks" if then.modes["corner"] == "stick" else "slides back"
        rows.append(f"| {mu} | {then.t0:.6f} | {angle:.6f} | {np.tan(angle):.4f} | {does} | {run['theta'][-1]:.6f} |")
    return "\n".join(rows)


def corner_plate() -> str:
    """Return the page of example 13.4.2."""
    scene = da.scenes.corner_plate()
    view = da.lagrange(scene)
    _, theta = scene.coordinates
    y = dynamicsymbols("y")
    wider = da.lagrange(scene.release(y, point(scene, "A"), scene.frame.y))
    unknowns = {str(u): u for u in wider.unknowns}
    (N_A,) = sp.solve(wider.equation(y).subs(y, 0).doit(), unknowns["N_A"])
    l, m = sp.symbols("l m", positive=True)
    rest = sp.simplify(N_A - m * l * (theta.diff() * sp.cos(theta)).diff(TIME))
    correction = sp.expand(wider.kinetic_energy - view.kinetic_energy)
    slip = view.geometry.components(view.slip_velocity("corner"), frame(scene, "S"))[0]
    return f"""# Example 13.4.2: a plate on the ground and a corner

Compare the text's derivation with that of the code, and add friction. The end A of a plate slides on the ground, and
the plate leans on a corner Q at height h. The origin is the foot of the corner, so that the constant of the text's
equation (3) is zero.

{derivation(view, da.scenes.corner_plate)}
## Friction, equation (4)

The body slips on the corner with the velocity

{show(SLIP, view.slip_velocity("corner"))}
which is x_dot cos(theta) along the plate, by the constraint. Coulomb's law $|F_Q| = \\mu N_Q$ needs the sign of
$F_Q$: friction opposes the slip velocity, so $F_Q$ has the sign of

$$-\\left({latex(slip)}\\right).$$

Without friction the corner is an ideal joint, which makes $F_Q = 0$. With friction, equation (4) is one line of the
scene, which needs no sign ([friction.md](../friction.md)); ``da.scenes.corner_plate(friction=True)`` has it:

{code(FRICTION)}
Pushed up with $\\dot\\theta = 1$ from $\\theta = 0.6$ (m = l = 1, h = 0.5, g = 9.81, F_A = 0), the plate
stops, and then:

{friction_table()}

It sticks, once it has stopped, where $\\tan\\theta \\le \\mu$: at rest, moments about A give
$N_Q = mgl\\sin\\theta\\cos\\theta/h$, and the horizontal forces $F_Q = N_Q\\tan\\theta$.

## The coordinate y released

{code(RELEASE_Y)}
The kinetic energy gains

$${latex(correction)},$$

the power coefficients of x and theta stay as they are, and there is a third equation:

{equations(wider, y)}
With y = 0 imposed, it gives

{show("N_A", sp.collect(sp.expand(N_A), m * l))}
The text prints $N_A = mg - N_Q\\cos\\theta - F_Q\\sin\\theta$ at this place: it drops the term
$ml\\,\\frac{{d}}{{dt}}(\\dot\\theta\\cos\\theta)$, the vertical acceleration of G times m. The left-hand side of the
equation for y is $m\\frac{{d}}{{dt}}(\\dot y + l\\dot\\theta\\cos\\theta)$; $y = 0$ for all time makes
$\\dot y = \\ddot y = 0$, but not $\\dot\\theta$. Without that term the vertical forces would be in balance, which
holds at rest only. By the code, $N_A - ml\\,\\frac{{d}}{{dt}}(\\dot\\theta\\cos\\theta)$ simplifies to

$${latex(rest)}.$$

``da.lagrange(scene.release(y, A, N.y)).reactions["N_A"]`` is N_A as a function of the state, without friction."""


def rolling_sphere() -> str:
    """Return the page of example 13.4.3."""
    scene = da.scenes.rolling_sphere()
    view = da.lagrange(scene)
    z = dynamicsymbols("z")
    wider = da.lagrange(scene.release(z, point(scene, "G"), scene.frame.z))
    return f"""# Example 13.4.3: a sphere that rolls without slip

Compare the text's derivation with that of the code, and find the normal force.

{derivation(view, da.scenes.rolling_sphere)}
## The coordinate z released

{code(RELEASE_Z)}
The other five equations stay as they are, and there is a sixth:

{equations(wider, z)}
With the constraint ${latex(wider.constraints[0].equation)}$ it gives

{show("N", wider.reactions["N"])}"""


def edge_plate() -> str:
    """Return the page of example 13.4.4."""
    scene = da.scenes.edge_plate()
    view = da.lagrange(scene)
    z = scene.coordinates[2]
    four = da.lagrange(scene.impose(z))
    ideal = "\n".join(f"$${latex(view.equation(q, ideal=True))}$$\n" for q in view.coordinates)
    model = da.compile_model(scene, backend="numpy")
    parameters = {"m": 1.2, "A": 0.05, "B": 0.09, "C": 0.14, "h": 0.4, "g": 9.81}
    start = {"x": 0, "y": 0, "psi": 0.3, "theta": 1.2, "x_dot": 0, "y_dot": 0, "psi_dot": 0, "theta_dot": 0}
    rows = []
    for F in (0.0, 0.01, 0.03):
        run = model.simulate((0, 0.2), start, {**parameters, "F": F}, t_eval=np.array([0.2]), rtol=1e-10)
        rows.append(f"| {F} | {run['theta'][-1]:.6f} | {run['psi'][-1] - 0.3:+.6f} |")
    table = "\n".join(rows)
    numbers = ", ".join(f"{k} = {v}" for k, v in parameters.items())
    return f"""# Example 13.4.4: a plate that slides on its edge

Compare the text's derivation with that of the code, with five coordinates and with four.

{derivation(view, da.scenes.edge_plate)}
## Equations (2) to (6), with the ideal joint

With X = Y = L = N = 0, ``view.equation(q, ideal=True)``:

{ideal}
Z and the motion are determined; the moment M is not. It holds the edge in the plane, a rotation about A.y that
the two angles exclude: ``scene.release(phi, A, A.y)`` adds that rotation and determines M.

## Four coordinates

{code("view = da.lagrange(scene.impose(z))")}
The constraint z = h sin(theta) is used up, Z is absent from the equations and becomes undetermined with M:

{equations(four, *four.coordinates)}
## Question d: released from rest

Simulated from rest over 0.2 s, with {numbers}, theta = 1.2 and psi = 0.3:

| F | theta | change of psi |
|---|---|---|
{table}

The edge keeps its direction when F = 0, and turns otherwise."""


def chaplygin_sleigh() -> str:
    """Return the page of example 13.4.6, with remarks 13.4.8 and 13.4.9."""
    scene = da.scenes.chaplygin_sleigh()
    view = da.lagrange(scene)
    x, y, theta = scene.coordinates
    m, I_C = sp.symbols("m I_C", positive=True)
    wrong = (m * (x.diff() ** 2 + y.diff() ** 2) + I_C * theta.diff() ** 2) / 2
    try:
        da.lagrange(scene, kinetic_energy=wrong)
        raise AssertionError("the kinetic energy of remark 13.4.8 must be refused")
    except da.errors.SceneError as refusal:
        message = str(refusal)
    left = "\n".join(f"$${latex(lagrange_operator(wrong, q))} = 0$$\n" for q in scene.coordinates)
    multipliers = "\n".join(f"$${latex(e)}$$\n" for e in view.multiplier_equations())
    maggi = "\n".join(f"$${latex(e)}$$\n" for e in view.maggi_equations())
    (value,) = view.multipliers.values()
    return f"""# Example 13.4.6: the Chaplygin sleigh

Compare the text's derivation with that of the code, and see which wrong equations the remarks warn of.

{derivation(view, da.scenes.chaplygin_sleigh)}
The text writes the first two equations of motion with $\\dot y = \\dot x\\tan\\theta$ from the constraint, which
divides by cos(theta); those above hold for every theta.

## Remark 13.4.8

The kinetic energy with the constraint used in it, ${latex(2 * wrong)} = 2T$, has the right value and the wrong
derivatives. ``da.lagrange(scene, kinetic_energy=...)`` raises an error:

```text
{chr(10).join(textwrap.wrap(message, 110))}
```

The erroneous equations that would follow, with an ideal joint:

{left}
## Remark 13.4.9

With a multiplier in place of the unknown reactions:

{multipliers}
{show(latex(sp.Symbol("lambda_1")), value)}
Projected on the motions that the constraint leaves free, where no reaction has power (section 13.6):

{maggi}"""


PAGES = {
    "13.4.2-corner-plate": corner_plate,
    "13.4.3-rolling-sphere": rolling_sphere,
    "13.4.4-edge-plate": edge_plate,
    "13.4.6-chaplygin-sleigh": chaplygin_sleigh,
}


def main() -> int:
    """Write or check the pages; return the number of pages that differ when checking."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing, tell which pages differ")
    check = parser.parse_args().check
    FOLDER.mkdir(exist_ok=True)
    stale = 0
    for name, build in PAGES.items():
        file, page = FOLDER / f"{name}.md", BANNER + build().rstrip() + "\n"
        if check and (not file.exists() or file.read_text() != page):
            print(f"{file} is not what the code gives")
            stale += 1
        elif not check:
            file.write_text(page)
            print(file)
    return stale


if __name__ == "__main__":
    sys.exit(main())
