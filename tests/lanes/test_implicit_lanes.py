"""Radau in lanes: linear algebra lane by lane, and sweeps that give each case the bits that it has alone."""

from typing import NamedTuple
from unittest.mock import patch

import numpy as np
import pytest
from sympy import sqrt, symbols, tanh
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen import library
from dalembert.codegen.llvm import assembly, loops
from dalembert.codegen.llvm.backend import LLVMLibrary
from dalembert.codegen.llvm.target import target
from dalembert.codegen.subset import loop_assembly
from dalembert.methods.status import Status
from dalembert.steps.lu import factor, factor_pair, solve, solve_pair
from dalembert.subset.arguments import IntMatrix, IntVector, Matrix, Vector
from dalembert.subset.compiled_subset import compiled_subset, lane_count, lanes, lanes_of, tell_target
from dalembert.subset.packing import address_of, pack

LOOSE = {"method": "radau", "rtol": 1e-5, "atol": 1e-7}
x = dynamicsymbols("x")


class Systems(NamedTuple):
    """A real and a complex system in each lane."""

    a: Matrix
    re: Matrix
    im: Matrix
    b: Vector
    c: Vector
    d: Vector
    pivots: IntVector
    numbers: Matrix
    flags: IntMatrix


@compiled_subset
def SOLVE(systems: Systems) -> int:
    for lane in lanes():
        systems.flags[0, lane] = systems.flags[1, lane] = 1
    factor(systems.a, systems.pivots, systems.numbers, 0, systems.flags, 0)
    solve(systems.a, systems.pivots, systems.b)
    factor_pair(systems.re, systems.im, systems.pivots, systems.numbers, 0, systems.flags, 1)
    solve_pair(systems.re, systems.im, systems.pivots, systems.c, systems.d)
    return lane_count()


def machine_code(loop, count):
    tell_target(fused=target().fused)  # plain Python rounds as the machine code does
    code = assembly.load_object(
        assembly.compile_object(loop_assembly(loop, fused=target().fused, lanes=count), "loops")
    )
    entry = code.address("entry").function(loops._ENTRY)

    def call(arguments):
        packed = pack(arguments)
        return entry(address_of(packed))

    return call


def systems_of(matrices, right):
    """Return systems of matrices (lanes, n, n) and right sides (lanes, n), both complex, and of their real parts."""
    count, n = right.shape

    def laid(values):
        return np.ascontiguousarray(np.moveaxis(values, 0, -1)).reshape(*values.shape[1:-1], -1)

    vectors = laid(right.real), laid(right.real), laid(right.imag)
    whole = np.zeros(n * (count + 2), np.int64), np.zeros((1, count)), np.zeros((2, count), np.int64)
    return Systems(laid(matrices.real), laid(matrices.real), laid(matrices.imag), *vectors, *whole)


def test_systems_of_lanes_have_pivots_of_their_own():
    rng, n, count = np.random.default_rng(3), 5, 4
    matrices = rng.standard_normal((count, n, n)) + 1j * rng.standard_normal((count, n, n))
    matrices[0] += 20.0 * np.eye(n)  # no row is exchanged
    matrices[1, :, 2] = 0.0  # singular
    matrices[3, 0, 0] = 0.0
    right = rng.standard_normal((count, n)) + 1j * rng.standard_normal((count, n))
    found = systems_of(matrices, right)
    assert machine_code(SOLVE, count)(found) == count
    np.testing.assert_array_equal(found.flags, [[1, 0, 1, 1]] * 2)
    plain = systems_of(matrices, right)
    with lanes_of(count), np.errstate(all="ignore"):
        assert SOLVE(plain) == count
    np.testing.assert_array_equal(found.b, plain.b)
    np.testing.assert_array_equal(found.d, plain.d)
    for lane in (0, 2, 3):
        np.testing.assert_allclose(found.b[lane::count], np.linalg.solve(matrices[lane].real, right[lane].real), 1e-11)
        pair = found.c[lane::count] + 1j * found.d[lane::count]
        np.testing.assert_allclose(pair, np.linalg.solve(matrices[lane], right[lane]), 1e-11)
        alone = systems_of(matrices[[lane]], right[[lane]])
        machine_code(SOLVE, 1)(alone)
        np.testing.assert_array_equal(alone.b, found.b[lane::count])
        np.testing.assert_array_equal(alone.c, found.c[lane::count])


@pytest.mark.skipif(not target().fused, reason="vectors of four need AVX2")
def test_loops_over_lanes_become_vectors():
    _, module = assembly._compiled(loop_assembly(SOLVE, fused=True, lanes=4), "loops")
    text = str(module)
    assert text.count("call <4 x double> @llvm.fma") >= 10
    assert "call double @llvm.fma" not in text


def block(load, *names, **options):
    """Return a model of one particle on a line, with a load of its position and velocity."""
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("block", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("block", P, symbols("m", positive=True)))
    if "inputs" in options:
        scene.add_inputs(*options["inputs"])
    scene.add_loads((P, load(*symbols(names, positive=True)) * N.x))
    return da.compile_model(scene)


def belt():
    return block(lambda k, mu, eps: -k * x + mu * tanh((1 - x.diff()) / eps), "k", "mu", "eps")


CASES = 11
START = {"x": 0.1, "x_dot": 0.0}
MANY = {"m": 1.0, "k": np.linspace(3.0, 9.0, CASES), "mu": np.linspace(4.0, 1.0, CASES), "eps": 1e-3}


def one_at_a_time(run):
    """Return what a run of a new model gives with one lane."""
    with patch.object(LLVMLibrary, "lanes", 1):
        return run()


def assert_equal_sweeps(run):
    """Assert that cases in lanes have the bits of cases one at a time; return the former."""
    many, single = run(), one_at_a_time(run)
    assert many.success.any()
    np.testing.assert_array_equal(many.status, single.status)
    np.testing.assert_array_equal(many.y, single.y)
    for name in many.final:
        np.testing.assert_array_equal(many[name], single[name])
    for name in many.reduced:
        np.testing.assert_array_equal(many.reduced[name], single.reduced[name])
    for name in many.events:
        for field in ("count", "first", "last"):
            np.testing.assert_array_equal(getattr(many.events[name], field), getattr(single.events[name], field))
    assert many.stats.steps == single.stats.steps
    return many


WHAT = {
    "nothing": {},
    "times": {"t_eval": np.linspace(0.0, 3.0, 8)},
    "events and maxima": {"events": ["x"], "reduce": {"most": da.maximum("x"), "mean": da.mean("x_dot")}},
    "the first event": {"events": [da.Event("x", terminal=True)]},
}


@pytest.mark.parametrize("what", WHAT)
def test_cases_in_lanes_have_the_bits_of_cases_one_at_a_time(what):
    assert_equal_sweeps(lambda: belt().sweep((0, 3), START, MANY, **LOOSE, **WHAT[what]))


def test_a_case_has_the_bits_of_a_single_run_whatever_stands_beside_it():
    model, order = belt(), np.random.default_rng(0).permutation(CASES)
    together = model.sweep((0, 3), START, MANY, **LOOSE)
    among = {**MANY, "k": MANY["k"][order], "mu": MANY["mu"][order]}
    np.testing.assert_array_equal(model.sweep((0, 3), START, among, **LOOSE).y, together.y[order])
    for i in (0, 4, CASES - 1):
        single = model.simulate((0, 3), START, {**MANY, "k": MANY["k"][i], "mu": MANY["mu"][i]}, **LOOSE)
        np.testing.assert_array_equal(single.y[-1], together.y[i])


def test_a_case_that_fails_leaves_the_others_alone():
    """It leaves the domain of its square root; one starts where its rate is not finite, another has no steps left."""
    model = block(lambda k: -k * x.diff() - sqrt(1 - x), "k")
    many = {"m": 1.0, "k": np.array([1e4, 1.0, 1e4, 1e3, 10.0])}
    start = {"x": np.array([0.5, 0.999, 2.0, 0.1, 0.99]), "x_dot": np.array([0.0, 1.0, 0.0, 0.0, 5.0])}
    found = model.sweep((0, 0.1), start, many, **LOOSE)
    assert found.status[2] == Status.NON_FINITE and found.status[0] == found.status[3] == Status.SUCCESS
    for i in range(5):
        alone = model.sweep((0, 0.1), {n: v[i] for n, v in start.items()}, {"m": 1.0, "k": many["k"][i]}, **LOOSE)
        assert alone.status[0] == found.status[i]
        np.testing.assert_array_equal(alone.y[0], found.y[i])


def test_knots_of_inputs_and_of_tables_in_lanes():
    u = dynamicsymbols("u")

    def run():
        table = da.table(x, [-1.0, 0.0, 0.4, 1.0], [2.0, 0.0, 30.0, 30.5], kind="linear", extrapolate="linear")
        model = block(lambda k: u - k * x.diff() - table, "k", inputs=[u])
        given = {u: da.samples([0.0, 0.3, 0.7, 1.0], np.outer(np.linspace(1, 9, CASES), [0, 1, 5, -3]), kind="linear")}
        many = {"m": 1.0, "k": np.geomspace(1.0, 1e4, CASES)}
        return model.sweep((0, 1), START, many, inputs=given, t_eval=[0.0, 0.3, 0.5, 1.0], **LOOSE)

    assert assert_equal_sweeps(run).success.all()


@pytest.mark.parametrize("formulation", ["projected", "ggl", "augmented"])
@pytest.mark.parametrize("columns", [False, True])
def test_constraints_in_lanes(formulation, columns):
    """Projections, and multipliers, whose Newton systems need pivots; Jacobians at once and by columns."""
    y = dynamicsymbols("y")

    def run():
        N, O = ReferenceFrame("N"), Point("O")
        g, k = symbols("g k", positive=True)
        P = O.locatenew("P", x * N.x + y * N.y)
        scene = da.Scene("bob", frame=N, origin=O, coordinates=[x, y])
        scene.add_bodies(Particle("bob", P, 1))
        scene.add_holonomic_constraints(x**2 + y**2 - 1)
        scene.add_loads((P, -g * N.y - k * (x.diff() - y) * N.x))
        model = da.compile_model(scene, formulation=formulation)
        many = {"g": np.linspace(5.0, 15.0, CASES), "k": np.geomspace(1.0, 1e4, CASES)}
        return model.sweep(
            (0, 1), {"x": 0.6, "y": -0.8, "x_dot": 0.4, "y_dot": 0.3}, many, t_eval=[0.0, 0.4, 1.0], **LOOSE
        )

    with patch.object(library, "_LARGEST_JACOBIAN", 0 if columns else library._LARGEST_JACOBIAN):
        assert assert_equal_sweeps(run).success.all()
