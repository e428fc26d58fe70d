"""Hostile names and options against every public function: success, or an error of the library that names the thing.

    python -m fuzz.hostile --count 10000 --seed 0        # in the folder of the tests

An attack is a valid call with one or two arguments, or the value of a key, replaced by something strange. Anything but
a result or a `DalembertError` is a defect: another exception, a crash, or no answer within `SECONDS`.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import math
import random
import signal
import sys
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from decimal import Decimal
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import DalembertError

__all__ = ["Outcome", "attack", "main"]

SECONDS = 30
TEXTS = (
    "",
    " ",
    "x",
    "X",
    "x_dot",
    "energy",
    "t",
    "class",
    "lambda",
    "None",
    "c",
    "out",
    "y",
    "p",
    "math",
    "a b",
    "a,b",
    "a:3",
    "__import__('os').system('false')",
    "x); import os; (",
    "a\nb",
    "a\r\n\tb",
    'quo"te',
    "quo'te",
    "back\\slash",
    "\\n",
    "{{ 7 * 7 }}",
    "{% raw %}",
    "%s%n",
    "$HOME",
    "../../etc/passwd",
    "~nosuchuser",
    "\x00",
    "\x1b[31m",
    "\ud800",
    "q\udfff",
    "ünïcode",
    "变量",
    "🙂",
    "\u202eabc",
    "a\u0301",
    "ﬁ",
    "x" * 300,
    "x" * 1200,
    "_",
    "__",
    "1",
    "1x",
    "nan",
    "inf",
    "-0",
    "1e400",
    "q_1",
    "q 1",
    "q-1",
    "q.1",
    "omega_S_x",
    "numpy",
    "taylor",
    "auto",
    "minimal",
    "projected",
    "baumgarte",
)


@cache
def deep(levels: int) -> Any:
    """Return functions in one another."""
    e = dynamicsymbols("x")
    for _ in range(levels):
        e = sp.sin(e) + sp.Symbol("k")
    return e


def things(rng: random.Random) -> Any:
    """Return something strange."""
    makers: list[Callable[[], Any]] = [
        lambda: rng.choice(TEXTS),
        lambda: rng.choice(
            [None, True, False, ..., NotImplemented, object(), type, Exception(), slice(None), range(3)]
        ),
        lambda: rng.choice([math.nan, math.inf, -math.inf, -1.0, 0.0, -0.0, 1e308, -1e308, 5e-324, 1e-400, 2.5, 1e20]),
        lambda: rng.choice([0, -1, 1, 7, 2**31, 2**63, 2**64, 10**400, -(10**400)]),
        lambda: rng.choice(
            [[], [[]], (), {}, set(), [None], [1, 2], ["x"], ("x", "x"), {1: 2}, {"x": "y"}, {None: None}]
        ),
        lambda: rng.choice(
            [{"x": 1, 1: 2}, {"x": 1.0, "x_dot": math.nan}, [math.nan], [1.0, math.inf], [[1.0], [2.0, 3.0]]]
        ),
        lambda: rng.choice(
            [np.array([]), np.array([1.0, math.nan]), np.zeros((2, 2, 2)), np.array(0.5), np.array("x")]
        ),
        lambda: rng.choice([np.array([1, "x"], dtype=object), np.array([1j]), np.array(["2020"], dtype="M8[D]")]),
        lambda: np.ma.masked_array([1.0, 2.0], mask=[False, True]),
        lambda: rng.choice([np.float32(1.5), np.int8(3), np.bool_(True), np.float64(math.nan), np.datetime64("2020")]),
        lambda: rng.choice([Fraction(1, 3), Decimal("0.1"), Decimal("nan"), Decimal("1e500"), 1j, complex(1, 0), b"x"]),
        lambda: rng.choice(
            [sp.Symbol("q"), sp.oo, sp.nan, sp.zoo, sp.Rational(1, 3), sp.pi, sp.I, sp.true, sp.Integer(2)]
        ),
        lambda: rng.choice(
            [dynamicsymbols("x"), dynamicsymbols("unknown"), dynamicsymbols("x").diff(), sp.Matrix([1, 2])]
        ),
        lambda: rng.choice([ReferenceFrame("F").x, ReferenceFrame("F"), Point("P"), sp.Eq(sp.Symbol("a"), 1)]),
        lambda: rng.choice(
            [sp.Integer(10) ** 400, sp.Float("1e400"), deep(600), sp.Symbol("x" * 1200), sp.Symbol("a\nb")]
        ),
        lambda: (i for i in range(3)),
        lambda: rng.choice([lambda *a: 0, lambda *a: 1 / 0, print, math.sin]),
    ]
    return rng.choice(makers)()


def changed(rng: random.Random, value: Any) -> Any:
    """Return a valid argument with something strange in it, or in its place."""
    if isinstance(value, dict) and value and rng.random() < 0.7:
        twin, key = dict(value), rng.choice(list(value))
        kind = rng.randrange(3)
        if kind == 0:
            twin[key] = things(rng)
        elif kind == 1:
            twin.pop(key)
        else:
            with contextlib.suppress(TypeError):
                twin[things(rng)] = 1.0
        return twin
    if isinstance(value, tuple | list) and value and rng.random() < 0.5:
        items = list(value)
        items[rng.randrange(len(items))] = things(rng)
        return type(value)(items)
    return things(rng)


@dataclass
class Outcome:
    """How attacks ended."""

    accepted: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    defects: list[tuple[int, str, str, str]] = field(default_factory=list)

    @property
    def count(self) -> int:
        """How many attacks there were."""
        return self.accepted + sum(self.refused.values()) + len(self.defects)


@dataclass
class Target:
    """A public function with valid arguments by name; `call` takes them as a mapping."""

    name: str
    call: Callable[[dict[str, Any]], Any]
    valid: Callable[[], dict[str, Any]]


def pendulum(**names: Any) -> tuple[da.Scene, dict[str, Any]]:
    """Return a bead on a rough circle with a reaction, its parts by name."""
    x, y = dynamicsymbols("x y")
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y)
    m, g, k = sp.symbols("m g k")
    scene = da.Scene("bead", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("bead", P, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_loads((P, -k * x * N.x))
    R, F = da.unknowns("R F")
    scene.add_joints(da.Joint("floor", body="bead", at=P, force=F * N.x + R * N.y))
    return scene, {"x": x, "y": y, "N": N, "O": O, "P": P, "m": m, "g": g, "k": k, "R": R, "F": F}


def long_span(span: Any) -> bool:
    """Whether a run takes long because it was asked to: this function has no limit of steps to give."""
    with contextlib.suppress(Exception):
        return bool(abs(float(span[1]) - float(span[0])) > 100)
    return False


class Targets:
    """The functions that are attacked, on models that are compiled once."""

    def __init__(self, backend: str = "numpy") -> None:
        scene, self.parts = pendulum()
        self.backend = backend
        self.start = {"x": 0.3, "y": 1.0, "x_dot": 0.1, "y_dot": 0.0}
        self.parameters = {"m": 1.0, "g": 9.81, "k": 2.0}
        self.model = da.compile_model(scene, backend=backend)
        self.run = self.model.simulate((0, 0.2), self.start, self.parameters)
        self.prepared = self.model.prepare((0, 0.1)) if backend != "jax" else None
        self.swept = self.model.sweep((0, 0.1), self.start, self.parameters | {"k": [1.0, 2.0]}, t_eval=[0.0, 0.1])
        self.all = [*self._running(), *self._evaluating(), *self._results(), *self._scenes(), *self._compiling()]

    def _span(self) -> dict[str, Any]:
        return {"t_span": (0.0, 0.1), "initial": dict(self.start), "parameters": dict(self.parameters)}

    def _state(self, name: str) -> dict[str, Any]:
        return {name: dict(self.start), "parameters": dict(self.parameters)}

    def _running(self) -> list[Target]:
        m = self.model
        limits = {"method": "auto", "rtol": 1e-6, "atol": 1e-8, "max_steps": 2000}

        def simulate() -> dict[str, Any]:
            more = {"first_step": None, "max_step": math.inf, "dense": True, "error_estimate": False}
            return self._span() | limits | more | {"t_eval": [0.0, 0.05], "events": (), "project_invariants": False}

        def sweep() -> dict[str, Any]:
            more = {"grid": None, "t_eval": [0.0, 0.1], "threads": None, "progress": False, "error_estimate": False}
            span = self._span()
            span["parameters"]["k"] = [1.0, 2.0]
            return (
                span | limits | more | {"max_step": math.inf, "events": (), "reduce": None, "project_invariants": False}
            )

        prepared = self.prepared
        targets = [
            Target("simulate", lambda a: m.simulate(**a), simulate),
            Target("sweep", lambda a: m.sweep(**a), sweep),
            Target("prepare", lambda a: m.prepare(**a), lambda: {"t_span": (0.0, 0.1), **limits, "max_step": math.inf}),
            Target(
                "sensitivity",
                lambda a: m.sensitivity(**a),
                lambda: self._span() | limits | {"wrt": ["k"], "of": ["x"], "t_eval": [0.1]},
            ),
            Target(
                "linearize",
                lambda a: m.linearize(**a),
                lambda: {"t": 0.0, **self._state("initial"), "states": None, "outputs": ["x"]},
            ),
            Target(
                "trim",
                lambda a: m.trim(**a),
                lambda: (
                    self._state("guess")
                    | {"free": ["x"], "steady": ["x_dot"], "t": 0.0, "tolerance": 1e-12, "max_iterations": 20}
                ),
            ),
            Target(
                "compare_formulations",
                lambda a: None if long_span(a["t_span"]) else m.compare_formulations(**a),
                lambda: self._span() | {"formulations": ["projected"], "method": "auto", "rtol": 1e-6, "atol": 1e-8},
            ),
            Target(
                "assemble",
                lambda a: m.assemble(**a),
                lambda: {"guess": dict(self.start), "parameters": dict(self.parameters), "t": 0.0, "fixed": ()},
            ),
        ]
        targets[4].valid = lambda: {
            "t": 0.0,
            "initial": dict(self.start),
            "parameters": dict(self.parameters),
            "states": None,
        }
        if prepared is not None and callable(prepared):
            names = {"initial": dict(self.start), "parameters": dict(self.parameters)}
            targets.append(
                Target("prepared run", lambda a: prepared(a["initial"], a["parameters"]), lambda: dict(names))
            )
        return targets

    def _evaluating(self) -> list[Target]:
        m, p = self.model, self.parameters
        point = {"t": 0.0, "q": [0.1, 0.2], "qdot": [0.0, 0.1], "p": dict(p)}
        pick = lambda *names: lambda: {name: point[name] for name in names}  # noqa: E731
        return [
            Target("mass_matrix", lambda a: m.mass_matrix(a["q"], a["p"], t=a["t"]), pick("t", "q", "p")),
            Target("forcing", lambda a: m.forcing(**a), pick("t", "q", "qdot", "p")),
            Target("accelerations", lambda a: m.accelerations(**a), pick("t", "q", "qdot", "p")),
            Target("constraint_jacobian", lambda a: m.constraint_jacobian(**a), pick("t", "q", "p")),
            Target("parameter_vector", lambda a: m.parameter_vector(a["p"]), pick("p")),
            Target(
                "state",
                lambda a: m.state(**a),
                lambda: {"initial": dict(self.start), "parameters": dict(p), "t": 0.0},
            ),
        ]

    def _results(self) -> list[Target]:
        run, swept = self.run, self.swept
        return [
            Target("trajectory[...]", lambda a: run[a["name"]], lambda: {"name": "x"}),
            Target("trajectory(t)", lambda a: run(a["t"]), lambda: {"t": [0.0, 0.1]}),
            Target("sweep[...]", lambda a: swept[a["name"]], lambda: {"name": "x"}),
            Target("plot", lambda a: run.plot(a["name"]), lambda: {"name": "x"}),
            Target(
                "animate",
                lambda a: run.animate(**a),
                lambda: {"fps": 10.0, "speed": 1.0, "points": ()},
            ),
            Target("grid", lambda a: da.grid(**a), lambda: {"k": [1.0, 2.0], "m": [1.0]}),
            Target("Event", self._event, lambda: {"expression": "x", "name": "e", "terminal": False}),
            Target("reduce", self._reduce, lambda: {"of": "x", "kind": "maximum"}),
        ]

    def _event(self, a: dict[str, Any]) -> Any:
        event = da.Event(a["expression"], name=a["name"], terminal=a["terminal"])
        return self.model.simulate(**self._span(), events=[event])

    def _reduce(self, a: dict[str, Any]) -> Any:
        kinds = {"maximum": da.maximum, "mean": da.mean, "final": da.final, "minimum": da.minimum}
        kind = kinds.get(a["kind"], da.maximum) if isinstance(a["kind"], str) else da.maximum
        return self.model.sweep(**self._span(), reduce={"r": kind(a["of"])})

    def _scenes(self) -> list[Target]:
        def body(a: dict[str, Any]) -> Any:
            scene, parts = pendulum()
            scene.bodies = ()
            with contextlib.suppress(TypeError, ValueError, sp.SympifyError, AttributeError, RecursionError):
                scene.add_bodies(Particle(a["name"], parts["P"], a["mass"]))  # what SymPy itself refuses
            scene.add_bodies(*(a["more"] if isinstance(a["more"], list | tuple) else [a["more"]]))
            return read_only(scene)

        def method(name: str, star: bool = True) -> Callable[[dict[str, Any]], Any]:
            def call(a: dict[str, Any]) -> Any:
                scene, _ = pendulum()
                items = a["items"]
                getattr(scene, name)(*(items if star and isinstance(items, list | tuple) else [items]))
                return read_only(scene)

            return call

        parts = self.parts
        fixed = {
            "add_bodies": [],
            "add_joints": [da.Joint("j", body="bead", at=parts["P"], force=parts["R"] * parts["N"].y)],
            "add_loads": [(parts["P"], parts["N"].x)],
            "add_holonomic_constraints": [parts["x"] - parts["y"]],
            "add_nonholonomic_constraints": [parts["x"].diff() - parts["y"].diff()],
            "add_friction": [da.CoulombFriction(parts["R"], parts["F"], mu=0.1)],
            "add_contacts": [da.UnilateralContact(parts["R"], gap=parts["y"])],
        }
        targets = [
            Target(name, method(name), lambda items=items: {"items": list(items)}) for name, items in fixed.items()
        ]
        targets += [
            Target("Scene", lambda a: da.Scene(a["name"], **{k: v for k, v in a.items() if k != "name"}), self._new),
            Target("apply_uniform_gravity", method("apply_uniform_gravity", False), lambda: {"items": parts["N"].x}),
            Target("bodies", body, lambda: {"name": "b", "mass": 1.0, "more": []}),
            Target("unknowns", lambda a: da.unknowns(a["names"]), lambda: {"names": "A B"}),
            Target("Joint", self._joint, lambda: {"name": "j", "body": "bead", "force": parts["R"] * parts["N"].y}),
            Target("CoulombFriction", self._friction, self._friction_valid),
            Target("UnilateralContact", self._contact, lambda: {"gap": parts["y"], "restitution": 0.5, "name": "c"}),
            Target("release", self._release, lambda: {"coordinate": dynamicsymbols("z"), "direction": None}),
            Target("impose", self._impose, lambda: {"coordinate": parts["y"], "expression": parts["x"]}),
            Target(
                "free_orientation", self._orient, lambda: {"names": ("a", "b", "c", "d"), "frame": ReferenceFrame("S")}
            ),
            Target("from_sympy", lambda a: da.Scene.from_sympy(a["source"]), lambda: {"source": None}),
            Target("lagrange", lambda a: da.lagrange(a["scene"]), lambda: {"scene": None}),
            Target("expression", self._expression, lambda: {"load": -parts["k"] * parts["x"], "parameter": "k"}),
        ]
        return targets

    def _new(self) -> dict[str, Any]:
        p = self.parts
        return {"name": "s", "frame": p["N"], "origin": p["O"], "coordinates": [p["x"]]}

    def _joint(self, a: dict[str, Any]) -> Any:
        scene, parts = pendulum()
        scene.joints = ()
        scene.add_joints(da.Joint(a["name"], body=a["body"], at=parts["P"], force=a["force"]))
        return read_only(scene)

    def _friction_valid(self) -> dict[str, Any]:
        p = self.parts
        return {
            "normal": p["R"],
            "tangential": p["F"],
            "slip": p["x"].diff(),
            "mu": 0.1,
            "mu_static": 0.2,
            "regularization": 1e-3,
            "name": "f",
        }

    def _friction(self, a: dict[str, Any]) -> Any:
        scene, parts = pendulum()
        scene.add_holonomic_constraints(parts["y"])
        scene.add_friction(da.CoulombFriction(**a))
        return read_only(scene)

    def _contact(self, a: dict[str, Any]) -> Any:
        scene, parts = pendulum()
        scene.add_contacts(da.UnilateralContact(parts["R"], **a))
        return read_only(scene)

    def _release(self, a: dict[str, Any]) -> Any:
        scene, parts = pendulum()
        direction = parts["N"].z if a["direction"] is None else a["direction"]
        return read_only(scene.release(a["coordinate"], parts["P"], direction))

    def _impose(self, a: dict[str, Any]) -> Any:
        scene, _ = pendulum()
        return read_only(scene.impose(a["coordinate"], a["expression"]))

    def _orient(self, a: dict[str, Any]) -> Any:
        scene, parts = pendulum()
        frame = a["frame"]
        da.free_orientation(scene, frame, names=a["names"])
        m = parts["m"]
        scene.add_bodies(RigidBody("top", parts["O"], frame, m, (inertia(frame, 1, 1, 1), parts["O"])))
        return read_only(scene)

    def _expression(self, a: dict[str, Any]) -> Any:
        scene, _ = pendulum()
        load, name = a["load"], a["parameter"]
        if isinstance(name, str) and name:
            load = load * sp.Symbol(name) if isinstance(load, sp.Expr) else load
        scene.potential = 0
        body = scene.bodies[0]
        body.potential_energy = load if isinstance(load, sp.Expr) else 0
        scene.add_holonomic_constraints(load)
        return read_only(scene)

    def _compiling(self) -> list[Target]:
        scene, _ = pendulum()

        def valid() -> dict[str, Any]:
            return {
                "source": scene,
                "backend": self.backend,
                "formulation": "projected",
                "outputs": ["x"],
                "cache": False,
                "gains": None,
                "orientation": "scene",
            }

        return [Target("compile_model", lambda a: da.compile_model(a.pop("source"), **a), valid)]


def read_only(scene: da.Scene) -> Any:
    """Return a scene read onto the graph and its equations, which is where all of its faults are found."""
    from dalembert.mechanics.derive import derive
    from dalembert.scene.reading import read

    return derive(read(scene))


def attack(targets: Targets, seed: int, outcome: Outcome) -> None:
    """Make one attack."""
    rng = random.Random(seed)
    target = rng.choice(targets.all)
    arguments = target.valid()
    for name in rng.sample(sorted(arguments), min(len(arguments), rng.choice((1, 1, 2)))):
        arguments[name] = changed(rng, arguments[name])
    shown = "?"
    with contextlib.suppress(BaseException):
        shown = ascii(arguments)[:300]
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()), limited(SECONDS):
            warnings.simplefilter("ignore")
            with np.errstate(all="ignore"):
                target.call(arguments)
    except DalembertError as error:
        text = str(error)
        if len(text) < 20 or len(text) > 20_000:
            outcome.defects.append((seed, target.name, shown, f"message of {len(text)} characters: {text[:80]!a}"))
        else:
            outcome.refused[target.name] += 1
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        where = [f"{f.filename.rsplit('/', 1)[-1]}:{f.lineno}" for f in traceback.extract_tb(error.__traceback__)[-6:]]
        outcome.defects.append((seed, target.name, shown, f"{type(error).__name__}: {ascii(str(error))[:120]} {where}"))
    else:
        outcome.accepted += 1


class NoAnswer(Exception):
    """An attack that did not end in time."""


@contextlib.contextmanager
def limited(seconds: int) -> Any:
    """Raise where the block takes longer, if this is the main thread."""

    def late(*_: Any) -> None:
        raise NoAnswer(f"no answer within {seconds} s")

    try:
        old = signal.signal(signal.SIGALRM, late)
    except ValueError:
        yield
        return
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, old)


def main(arguments: list[str] | None = None) -> int:
    """Run attacks and print what came of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--backend", default="numpy")
    given = parser.parse_args(arguments)
    targets, outcome = Targets(given.backend), Outcome()
    for seed in range(given.seed, given.seed + given.count):
        attack(targets, seed, outcome)
    print(f"{outcome.count} attacks: {outcome.accepted} accepted, {sum(outcome.refused.values())} refused by name")
    print(f"{len(outcome.defects)} defects")
    for seed, name, shown, what in outcome.defects:
        print(f"  seed {seed}: {name} {shown}\n    {what}")
    return 1 if outcome.defects else 0


if __name__ == "__main__":
    sys.exit(main())
