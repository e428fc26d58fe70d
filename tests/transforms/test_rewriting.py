"""Forms with few products: the same values, fewer products, and none of the digits lost."""

import math
import random

import mpmath
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import dalembert as da
from dalembert.ir.graph import Graph
from dalembert.ir.interpret import interpret
from dalembert.lowering.programs import lower
from dalembert.mechanics.derive import derive
from dalembert.reduction import reduce
from dalembert.scene.reading import read
from dalembert.transforms.lower_kernels import lower_kernel
from dalembert.transforms.rewriting import rewritten
from ir.trees import EXTENDED, NAMES, POINT, TREES, OutOfDomain, build, evaluate, extended
from mechanics.chains import chain
from scene.builders import unequal_sphere


def dots(kernel):
    """Return how many products, quotients and squares of varying values a kernel has, and (sin or cos) of them."""
    varying = {load.target for load in kernel.loads if load.array in ("t", "y")}
    count = 0
    for line in kernel.body:
        args = [arg for arg in line.args if arg in varying]
        if args:
            varying.add(line.target)
        both = line.op == "mul" and len(args) == 2
        count += both or line.op in ("sin", "cos", "sqrt") or (line.op == "div" and line.args[1] in varying)
    return count


@settings(max_examples=60)
@given(st.lists(TREES, min_size=1, max_size=4), st.sets(st.sampled_from(NAMES)))
def test_values_are_kept(trees, fixed):
    graph = Graph()
    with mpmath.workdps(60):
        point = {name: mpmath.mpf(value) for name, value in POINT.items()}
        try:
            expected = [extended(tree, point) for tree in trees]
            nodes = [build(graph, tree) for tree in trees]
            found = evaluate(graph, nodes, point, sorted(fixed))
        except (OutOfDomain, ZeroDivisionError):
            assume(False)
        for a, b in zip(found, expected, strict=True):
            assert abs(a - b) <= 1e-9 * max(1, abs(b))  # literals are rounded to floats


@st.composite
def shared_sums(draw):
    """Return a graph and values rich in products, sums and quotients that share their parts."""
    graph = Graph()
    inputs = [graph.input(name) for name in (*NAMES, "a", "b")]
    nodes = [*inputs, *(f(x) for x in inputs[:2] for f in (graph.sin, graph.cos))]
    for _ in range(draw(st.integers(1, 30))):
        op = draw(st.sampled_from(("add", "sub", "mul", "mul", "mul", "div")))
        a, b = (draw(st.one_of(st.sampled_from(nodes), st.sampled_from(nodes[-4:]))) for _ in range(2))
        if op != "div" or not b.is_zero:
            nodes.append(graph.call(op, a, b))
    return graph, nodes[-draw(st.integers(1, 6)) :]


@settings(max_examples=50)
@given(shared_sums(), st.sets(st.sampled_from((*NAMES, "a", "b"))))
def test_every_form_has_the_value_of_its_node(case, fixed):
    graph, nodes = case
    forms, outputs = rewritten(graph, nodes, sorted(fixed))
    assert [node.fingerprint for node in outputs] == [node.fingerprint for node in nodes]
    fresh, done = Graph(), {}
    for node in forms.graph.topological(outputs, forms.args):
        op, args = forms.of(node)
        assert all(arg.index in done for arg in args), f"{node!r} depends on itself"
        again = fresh.adopt([node])[0] if not args else fresh.call(op, *(done[arg.index] for arg in args))
        assert again.fingerprint == node.fingerprint
        done[node.index] = again


CHEAPER = {
    "common divisor": (lambda g, x, y, a, b: x * y / g.sin(x) + a * y / g.sin(x), 3),
    "common factor": (lambda g, x, y, a, b: x * (y * g.sin(x)) + y * (y * g.sin(x)), 3),
    "equal products": (lambda g, x, y, a, b: x * (a * y) - y * (b * x), 1),
    "squares that add up": (
        lambda g, x, y, a, b: x * (g.sin(y) * g.sin(y)) + a * (g.sin(y) * g.sin(y)) + a * (g.cos(y) * g.cos(y)),
        4,
    ),
    "parameters between factors": (lambda g, x, y, a, b: (x * a) * (y * b), 1),
    "square of a product": (lambda g, x, y, a, b: x * (y * (a * (x * y))), 2),
}


@pytest.mark.parametrize("name", CHEAPER)
def test_products_are_few(name):
    graph = Graph()
    write, most = CHEAPER[name]
    inputs = {graph.input(n): ("y" if n in "xy" else "p", i) for i, n in enumerate("xyab")}
    node = write(graph, *inputs)
    plain = lower_kernel(graph, "rhs", [node], inputs)
    kernel = lower_kernel(graph, "rhs", [node], inputs, fixed=list(inputs)[2:])
    assert dots(kernel) <= most
    assert dots(kernel) <= dots(plain)
    arguments = {"t": 0.0, "y": [0.7, 1.9, 0.0, 0.0], "p": [0.0, 0.0, 1.3, 0.4]}
    assert interpret(kernel, arguments) == pytest.approx(interpret(plain, arguments), rel=1e-14)


def test_one_square_is_not_written_as_a_difference():
    # 1 - sin(y)**2 would share its square, and lose the digits of cos(y)**2 where that is small
    graph = Graph()
    y = graph.input("y")
    square = graph.sin(y) * graph.sin(y)
    kernel = lower_kernel(graph, "rhs", [square, graph.cos(y) * graph.cos(y)], {y: ("y", 0)}, fixed=[])
    angle = math.pi / 2 - 1e-7
    assert interpret(kernel, {"t": 0.0, "y": [angle], "p": []})[1] == pytest.approx(math.cos(angle) ** 2, rel=1e-14)


SCENES = {
    "sleigh": (da.scenes.chaplygin_sleigh, 6),
    "sphere": (da.scenes.rolling_sphere, 12),
    "unequal sphere": (unequal_sphere, 32),
    "corner plate": (da.scenes.corner_plate, 11),
    "edge plate": (da.scenes.edge_plate, 17),
    "planar chain": (lambda: chain("planar", 3), 40),
    "spatial chain": (lambda: chain("spatial", 3), 42),
}


@pytest.mark.parametrize("name", SCENES)
def test_right_hand_sides_of_scenes(name):
    scene, most = SCENES[name]
    system = reduce(derive(read(scene(), ())), "auto")
    program = lower(system)
    kernel, prepare = program.kernel("rhs"), program.kernel("prepare")
    assert dots(kernel) <= most
    graph, names = system.equations.graph, program.layout.parameters
    inputs = {graph.input(name): ("p", i) for i, name in enumerate(names)}
    inputs |= {node: ("y", i) for i, node in enumerate(system.inputs)}
    plain = lower_kernel(graph, "rhs", system.rhs, inputs)
    rng = random.Random(5)
    with mpmath.workdps(40):
        for trial in range(60):
            y = [rng.uniform(-3, 3) for _ in system.inputs]
            if trial % 3 == 0:  # next to where sines and cosines vanish
                y[rng.randrange(len(y))] = rng.choice((0.0, math.pi / 2, math.pi)) + 10 ** rng.uniform(-5, -1)
            p = [rng.uniform(0.5, 2) for _ in names]
            state = {"t": mpmath.mpf(0), "y": list(map(mpmath.mpf, y)), "p": list(map(mpmath.mpf, p))}
            exact = interpret(plain, state, EXTENDED, mpmath.mpf)
            found = interpret(kernel, {"t": 0.0, "y": y, "c": interpret(prepare, {"p": p})})
            size = max(map(abs, exact))
            assert all(abs(a - b) <= 1e-12 * size for a, b in zip(found, exact, strict=True))
