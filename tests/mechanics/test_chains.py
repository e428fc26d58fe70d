"""Chains: right at random states, and of a size that grows no faster than it must."""

import functools
import math

import numpy as np
import pytest

import dalembert as da
from dalembert.lowering.programs import lower
from dalembert.mechanics.derive import derive
from dalembert.reduction import reduce
from dalembert.scene.reading import read
from mechanics.chains import KINDS, chain, random_parameters, recursion

kinds = pytest.mark.parametrize("kind", KINDS)


@kinds
@pytest.mark.parametrize("n", [1, 2, 5, 10])
def test_mass_matrix_forcing_and_accelerations_are_those_of_the_recursion(kind, n):
    model = da.compile_model(chain(kind, n), backend="numpy")
    rng = np.random.default_rng(n)
    for _ in range(4):
        named, arguments = random_parameters(kind, n, rng)
        q, qdot = rng.uniform(-4, 4, n), rng.uniform(-3, 3, n)
        mass, forcing = recursion(kind, q, qdot, arguments)
        np.testing.assert_allclose(model.mass_matrix(q, named), mass, rtol=1e-11, atol=1e-12 * np.abs(mass).max())
        scale = max(np.abs(forcing).max(), np.abs(mass).max() * np.abs(qdot).max() ** 2)
        np.testing.assert_allclose(model.forcing(0.0, q, qdot, named), forcing, rtol=1e-11, atol=1e-12 * scale)
        found = model.accelerations(0.0, q, qdot, named)
        residual = mass @ found - forcing
        assert np.abs(residual).max() < 1e-9 * max(scale, np.abs(mass).max() * np.abs(found).max())


@functools.cache
def sizes(kind, n):
    """Return nodes of the graph, operations of the mass matrix and of the right-hand side."""
    equations = derive(read(chain(kind, n)))
    program = lower(reduce(equations, "minimal"))
    names = ("mass_matrix", "momenta", "rhs", "forcing")
    counts = {name: len(program.kernel(name).body) for name in names if name in program}
    return {"graph": len(equations.graph.nodes), **counts}


FEW = {"mass_matrix": 2.2, "forcing": 1.3, "rhs": 3.1, "graph": 3.1}
MANY = {"momenta": 1.15, "forcing": 1.15, "rhs": 1.15, "graph": 1.15}


@kinds
@pytest.mark.parametrize(("small", "large", "limits"), [(7, 13, FEW), (20, 40, MANY), (40, 80, MANY)])
def test_operations_grow_no_faster_than_they_must(kind, small, large, limits):
    """Of few links the mass matrix grows as n^2 and the unrolled solve as n^3; of many all grows as n."""
    for what, limit in limits.items():
        growth = math.log(sizes(kind, large)[what] / sizes(kind, small)[what]) / math.log(large / small)
        assert growth <= limit, what


@pytest.mark.parametrize(("kind", "nodes", "rhs"), [("planar", 10_000, 2_000), ("spatial", 15_000, 6_000)])
def test_twenty_links_stay_small(kind, nodes, rhs):
    """What stands for five seconds from Scene to Program, without a clock."""
    size = sizes(kind, 20)
    assert size["graph"] <= nodes, size
    assert size["rhs"] <= rhs, size
