"""Elementary functions in lanes: how far they are from the exact values, and how long they and sweeps with them take.

    python benchmarks/elementary.py                 # prints the table, of 1e7 arguments each
    python benchmarks/elementary.py --write         # also writes docs/speed.md
    python benchmarks/elementary.py --count 1e5

Errors are in units in the last place, against numbers of 64 binary digits where the processor has them. Times are the
least of many calls, in nanoseconds of the processor a value: of code in lanes, of the C library lane by lane, and of
NumPy on an array. The sweeps are of blocks on a moving belt, held by springs, whose friction is smoothed by different
functions of the slip velocity; a root is the yardstick, because it is an instruction.
"""

from __future__ import annotations

import argparse
import ctypes
import sys
from collections.abc import Callable
from time import process_time
from typing import Any

import numpy as np
import sympy as sp
from exact import ROOT
from measure import machine
from numpy.typing import NDArray
from report import describe_machine, fill_page
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen.llvm.assembly import assembly, compile_object, load_object
from dalembert.codegen.llvm.definitions import with_definitions
from dalembert.codegen.llvm.target import native_lanes
from dalembert.ir.kernel import Assignment, Kernel, Load

Array = NDArray[np.float64]
PAGE = ROOT / "docs" / "speed.md"
MARKS = "<!-- elementary functions: benchmarks/elementary.py --write -->", "<!-- end of elementary functions -->"
AT_ONCE = 16
"""Values in every lane that one call computes."""
CHUNK = 100_000


def _sizes(rng: np.random.Generator, least: float, most: float, count: int) -> Array:
    """Return numbers spread evenly over powers of ten, of both signs."""
    return np.asarray(10.0 ** rng.uniform(least, most, count) * rng.choice([-1.0, 1.0], count))


Draw = Callable[[np.random.Generator, int], tuple[Array, ...]]
FUNCTIONS: dict[str, tuple[Any, str, list[Draw]]] = {
    "tan": (
        np.tan,
        "-1e6 to 1e6",
        [lambda g, n: (g.uniform(-1.6, 1.6, n),), lambda g, n: (_sizes(g, -20.0, 6.0, n),)],
    ),
    "exp": (
        np.exp,
        "-708 to 708",
        [lambda g, n: (g.uniform(-708.0, 708.0, n),), lambda g, n: (g.normal(0.0, 1.0, n),)],
    ),
    "log": (
        np.log,
        "1e-307 to 1e308",
        [lambda g, n: (10.0 ** g.uniform(-307.0, 308.0, n),), lambda g, n: (g.uniform(0.5, 2.0, n),)],
    ),
    "tanh": (
        np.tanh,
        "1e-20 to 30",
        [lambda g, n: (g.normal(0.0, 1.0, n),), lambda g, n: (_sizes(g, -20.0, 1.5, n),)],
    ),
    "sinh": (
        np.sinh,
        "1e-20 to 708",
        [lambda g, n: (g.normal(0.0, 1.0, n),), lambda g, n: (_sizes(g, -20.0, 2.85, n),)],
    ),
    "cosh": (
        np.cosh,
        "1e-20 to 708",
        [lambda g, n: (g.normal(0.0, 1.0, n),), lambda g, n: (_sizes(g, -20.0, 2.85, n),)],
    ),
    "asin": (
        np.arcsin,
        "1e-20 to 1",
        [lambda g, n: (g.uniform(-1.0, 1.0, n),), lambda g, n: (_sizes(g, -20.0, 0.0, n),)],
    ),
    "acos": (
        np.arccos,
        "1e-20 to 1",
        [lambda g, n: (g.uniform(-1.0, 1.0, n),), lambda g, n: (_sizes(g, -20.0, 0.0, n),)],
    ),
    "atan": (
        np.arctan,
        "1e-20 to 1e20",
        [lambda g, n: (g.normal(0.0, 1.0, n),), lambda g, n: (_sizes(g, -20.0, 20.0, n),)],
    ),
    "atan2": (
        np.arctan2,
        "both 1e-20 to 1e20",
        [
            lambda g, n: (g.normal(0.0, 1.0, n), g.normal(0.0, 1.0, n)),
            lambda g, n: (_sizes(g, -20.0, 20.0, n), _sizes(g, -20.0, 20.0, n)),
        ],
    ),
    "pow": (
        np.power,
        "1e-150 to 1e150, to -700 to 700",
        [
            lambda g, n: (10.0 ** g.uniform(-150.0, 150.0, n), g.uniform(-2.0, 2.0, n)),
            lambda g, n: (g.uniform(0.5, 2.0, n), g.uniform(-700.0, 700.0, n)),
        ],
    ),
}


class Compiled:
    """A function in lanes, of `AT_ONCE` values in every lane; where `exact`, the C library's."""

    def __init__(self, name: str, arity: int, *, exact: bool) -> None:
        self.lanes, self.arity = native_lanes(), arity
        loads = tuple(Load(f"x{i}_{n}", "y", i * arity + n) for i in range(AT_ONCE) for n in range(arity))
        body = tuple(Assignment(f"z{i}", name, tuple(f"x{i}_{n}" for n in range(arity))) for i in range(AT_ONCE))
        kernel = Kernel("k", ("y",), loads, body, tuple(line.target for line in body))
        self._library = load_object(
            compile_object(with_definitions(assembly([("k", kernel)], self.lanes, exact=exact)))
        )
        self.call = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(self._library.address("k"))

    @property
    def size(self) -> int:
        """Number of values of a call."""
        return AT_ONCE * self.lanes

    def __call__(self, given: tuple[Array, ...]) -> Array:
        """Return values (k,); k is a multiple of the size of a call."""
        columns = np.array(given).reshape(self.arity, -1, AT_ONCE, self.lanes)
        packed = np.ascontiguousarray(columns.transpose(1, 2, 0, 3))
        out = np.empty((packed.shape[0], AT_ONCE, self.lanes))
        for block, found in zip(packed, out, strict=True):
            self.call(block.ctypes.data, found.ctypes.data)
        return out.ravel()


def worst(compiled: Compiled, function: Any, draws: list[Draw], count: int) -> tuple[float, float]:
    """Return the largest error [ulp] in lanes, and that of NumPy."""
    rng, size = np.random.default_rng(1), CHUNK - CHUNK % compiled.size
    errors = [0.0, 0.0]
    for n in range(max(1, count // size)):
        given = draws[n % len(draws)](rng, size)
        exact = function(*(x.astype(np.longdouble) for x in given))
        unit = np.spacing(np.abs(exact.astype(float))).astype(np.longdouble)
        kept = np.isfinite(unit) & (np.abs(exact) > 2.0**-1021)
        for place, found in enumerate((compiled(given), function(*given))):
            errors[place] = max(errors[place], float(np.max(np.abs(found - exact)[kept] / unit[kept])))
    return errors[0], errors[1]


def nanoseconds(run: Callable[[], Any], values: int) -> float:
    """Return the least time of a value."""
    best = float("inf")
    for _ in range(40):
        begin = process_time()
        for _ in range(200):
            run()
        best = min(best, process_time() - begin)
    return 1e9 * best / (200 * values)


def row(name: str, count: int) -> str:
    """Return a row of the table."""
    function, domain, draws = FUNCTIONS[name]
    lanes, library = (Compiled(name, function.nin, exact=exact) for exact in (False, True))
    errors = worst(lanes, function, draws, count)
    given = draws[0](np.random.default_rng(2), lanes.size)
    packed = np.array(given).reshape(lanes.arity, AT_ONCE, lanes.lanes).transpose(1, 0, 2).copy()
    out = np.empty(lanes.size)
    addresses = packed.ctypes.data, out.ctypes.data
    times = [nanoseconds(lambda c=c: c.call(*addresses), lanes.size) for c in (lanes, library)]
    many = tuple(np.resize(x, 8192) for x in given)
    begin = nanoseconds(lambda: function(*many), 8192) if len(many) else 0.0
    cells = [f"{error:.2f}" for error in errors] + [f"{t:.1f}" for t in (*times, begin)]
    return f"| {name} | {domain} | {' | '.join(cells)} |"


LAWS: dict[str, Callable[[Any], Any]] = {
    "z / sqrt(1 + z^2)": lambda z: z / sp.sqrt(1 + z**2),
    "tanh(z)": sp.tanh,
    "2 / pi atan(z)": lambda z: 2 / sp.pi * sp.atan(z),
    "z (1 + z^2)^-0.37": lambda z: z * (1 + z**2) ** sp.Float(-0.37),
    "tanh(z) (1 + exp(-z^2))": lambda z: sp.tanh(z) * (1 + sp.exp(-(z**2))),
}
CASES = 4096


def _block(law: Callable[[Any], Any]) -> da.Scene:
    """Return a block on a belt, held by a spring, with friction by a law of slip over a small velocity."""
    x, (m, k, mu, v, e, g) = dynamicsymbols("x"), sp.symbols("m k mu v e g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("block", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("block", P, m))
    scene.add_loads((P, (-k * x - mu * m * g * law((x.diff() - v) / e)) * N.x))
    return scene


def of_sweeps() -> list[str]:
    """Return a table of microseconds a case by laws of friction and methods."""
    lines = ["| friction | taylor, us a case | dop853, us a case |", "|---|--:|--:|"]
    p = {"m": 1.0, "mu": 0.3, "v": 0.5, "e": 0.3, "g": 9.81, "k": np.linspace(5.0, 15.0, CASES)}
    for name, law in LAWS.items():
        model, cells = da.compile_model(_block(law)), []
        for method in ("taylor", "dop853"):
            options: dict[str, Any] = {"rtol": 1e-8, "atol": 1e-10, "threads": 1, "method": method}
            best = float("inf")
            for _ in range(6):
                begin = process_time()
                model.sweep((0.0, 10.0), {"x": 0.1, "x_dot": 0.0}, p, **options)
                best = min(best, process_time() - begin)
            cells.append(f"{1e6 * best / CASES:.2f}")
        lines.append(f"| {name} | {' | '.join(cells)} |")
        print(lines[-1], flush=True)
    return lines


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=float, default=1e7, help="arguments of each function")
    parser.add_argument("--write", action="store_true", help="write the table into docs/speed.md")
    options = parser.parse_args()
    lines = [
        "| function | arguments | error in lanes, ulp | of NumPy | in lanes, ns | C library | NumPy |",
        "|---|---|--:|--:|--:|--:|--:|",
    ]
    for name in FUNCTIONS:
        lines.append(row(name, int(options.count)))
        print(lines[-1], flush=True)
    sweeps = of_sweeps()
    if options.write:
        note = f"{int(options.count):.0e} arguments each, {describe_machine(machine())}."
        fill_page(PAGE, MARKS, "\n".join([*lines, "", *sweeps, "", note]))


if __name__ == "__main__":
    sys.exit(main())
