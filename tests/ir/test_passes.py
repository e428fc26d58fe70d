"""Passes keep values, and the verifier refuses whatever is not in SSA form."""

import math
from collections import Counter
from dataclasses import replace

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from dalembert.ir.interpret import interpret
from dalembert.ir.kernel import Assignment, Kernel, Load, count_operations
from dalembert.ir.ops import OPERATIONS
from dalembert.ir.verify import MalformedKernel, verify
from dalembert.transforms.passes import (
    eliminate_dead_code,
    group_products,
    hoist_parameters,
    run,
    share_equal,
    share_reciprocals,
)

PASSES = (group_products, share_reciprocals, share_equal, eliminate_dead_code)
ARGUMENTS = {
    "t": 0.37,
    "y": [0.81, -1.3, 0.45],
    "p": [1.7, 0.6, 2.3],
}
LOADS = (
    Load("t_1", "t", None),
    *(Load(f"q{i}", "y", i) for i in range(3)),
    *(Load(f"m{i}", "p", i) for i in range(3)),
)
PARAMETERS = ("m0", "m1", "m2")


@st.composite
def kernels(draw, name="rhs"):
    """Return a random kernel, rich in products and quotients of parameters and states."""
    names = [load.target for load in LOADS]
    body = []
    for place in range(draw(st.integers(1, 18))):
        op = draw(st.sampled_from(["mul", "div", "mul", "div", "add", "sub", "neg", "sin", "less", "select", "abs"]))
        operand = st.one_of(st.sampled_from(names), st.sampled_from(names[-6:]), st.sampled_from((2.0, -0.5, 3.25)))
        args = tuple(draw(operand) for _ in range(OPERATIONS[op].arity))
        body.append(Assignment(f"z{place}", op, args))
        names.append(f"z{place}")
    outputs = draw(st.lists(st.one_of(st.sampled_from(names), st.just(1.5)), min_size=1, max_size=4))
    return verify(Kernel(name, ("t", "y", "p"), LOADS, tuple(body), tuple(outputs)))


def values(kernel, arguments=ARGUMENTS):
    """Return the outputs, or None where rounding decides about them: near poles and comparisons."""
    held = {}

    def near(a, b):
        if abs(a - b) < 1e-9 * max(1.0, abs(a), abs(b)):
            held["edge"] = True
        return float(a < b)

    def divide(a, b):
        if abs(b) < 1e-6:
            held["edge"] = True
            return 0.0
        return a / b

    table = {name: op.evaluate for name, op in OPERATIONS.items()} | {"less": near, "div": divide}
    result = interpret(kernel, arguments, table)
    if held or any(abs(value) > 1e9 for value in result):
        return None
    return result


@pytest.mark.parametrize("step", PASSES, ids=lambda step: step.__name__)
@settings(max_examples=60)
@given(data=st.data())
def test_pass_keeps_the_values(step, data):
    kernel = data.draw(kernels())
    expected = values(kernel)
    assume(expected is not None)
    after = verify(step(kernel))
    assert (after.name, after.arguments, len(after.outputs)) == (kernel.name, kernel.arguments, len(kernel.outputs))
    found = interpret(after, ARGUMENTS)
    assert found == pytest.approx(expected, rel=1e-7, abs=1e-7)


@settings(max_examples=60)
@given(kernels("rhs"), kernels("energy"))
def test_hoisting_keeps_the_values(first, second):
    expected = [values(first), values(second)]
    assume(None not in expected)
    hoisted = hoist_parameters([run(k, PASSES) for k in (first, second)], PARAMETERS)
    c = interpret(hoisted.prepare, {"p": ARGUMENTS["p"]})
    assert c[:3] == ARGUMENTS["p"]
    for kernel, outputs in zip(hoisted.kernels, expected, strict=True):
        assert "p" not in {load.array for load in kernel.loads} | set(kernel.arguments)
        found = interpret(kernel, {"t": ARGUMENTS["t"], "y": ARGUMENTS["y"], "c": c})
        assert found == pytest.approx(outputs, rel=1e-7, abs=1e-7)


@settings(max_examples=40)
@given(kernels())
def test_nothing_of_parameters_alone_stays_after_hoisting(kernel):
    (hoisted,) = hoist_parameters([kernel], PARAMETERS).kernels
    constant = {load.target for load in hoisted.loads if load.array == "c"}
    for line in hoisted.body:
        assert not all(not isinstance(arg, str) or arg in constant for arg in line.args), line


@settings(max_examples=40)
@given(kernels())
def test_dead_code_is_gone_and_live_code_stays(kernel):
    after = eliminate_dead_code(kernel)
    used = {arg for line in after.body for arg in line.args} | set(after.outputs)
    assert all(line.target in used for line in after.body)
    assert all(load.target in used for load in after.loads)
    assert set(after.body) <= set(kernel.body)
    assert eliminate_dead_code(after) == after


@settings(max_examples=40)
@given(kernels())
def test_a_divisor_divides_twice_at_most(kernel):
    after = share_reciprocals(kernel)
    divisors = Counter(line.args[1] for line in after.body if line.op == "div" and isinstance(line.args[1], str))
    before = Counter(line.args[1] for line in kernel.body if line.op == "div" and isinstance(line.args[1], str))
    assert divisors == {d: count if count < 3 else 1 for d, count in before.items()}


@settings(max_examples=40)
@given(kernels())
def test_nothing_is_computed_twice(kernel):
    after = share_equal(kernel)
    lines = [
        (line.op, frozenset(map(str, line.args)) if line.op in ("add", "mul") else line.args) for line in after.body
    ]
    assert len(lines) == len(set(lines))
    assert share_equal(after) == after


@settings(max_examples=40)
@given(kernels())
def test_grouping_products_leaves_no_more_work_an_evaluation(kernel):
    def work(k):
        (hoisted,) = hoist_parameters([eliminate_dead_code(k)], PARAMETERS).kernels
        return count_operations(hoisted)["flops"]

    assert work(group_products(kernel)) <= work(kernel)


def test_factors_of_parameters_are_gathered():
    body = (
        Assignment("a", "mul", ("m0", "q0")),
        Assignment("b", "mul", ("a", "m1")),
        Assignment("c", "mul", ("q1", "b")),
        Assignment("d", "div", ("c", "m2")),
    )
    kernel = Kernel("rhs", ("t", "y", "p"), LOADS, body, ("d",))
    (hoisted,) = hoist_parameters([run(kernel, PASSES)], PARAMETERS).kernels
    assert count_operations(hoisted)["flops"] == 2  # (m0 m1/m2) (q0 q1)


def test_equal_expressions_of_two_kernels_share_a_constant():
    one = Kernel("rhs", ("t", "y", "p"), LOADS, (Assignment("a", "mul", ("m0", "m1")),), ("a",))
    two = replace(one, name="energy", body=(Assignment("b", "mul", ("m0", "m1")),), outputs=("b",))
    hoisted = hoist_parameters([one, two], PARAMETERS)
    assert len(hoisted.prepare.outputs) == 4
    assert count_operations(hoisted.prepare)["flops"] == 1


GOOD = Kernel(
    "rhs",
    ("t", "y", "p"),
    (Load("a", "y", 0), Load("b", "t", None)),
    (Assignment("c", "add", ("a", "b")), Assignment("d", "sin", ("c",))),
    ("d", 1.0),
)

MALFORMED = {
    "assigned twice": (replace(GOOD, body=(*GOOD.body, Assignment("c", "neg", ("a",)))), "c is assigned twice"),
    "a load assigned again": (replace(GOOD, body=(*GOOD.body, Assignment("a", "neg", ("b",)))), "a is assigned twice"),
    "loaded twice": (replace(GOOD, loads=(*GOOD.loads, Load("a", "y", 1))), "a is assigned twice"),
    "used before": (replace(GOOD, body=GOOD.body[::-1]), "d uses c before"),
    "uses itself": (replace(GOOD, body=(Assignment("c", "add", ("c", "a")),), outputs=("c",)), "c uses c before"),
    "output never assigned": (replace(GOOD, outputs=("nothing",)), "an output uses nothing before"),
    "unknown operation": (
        replace(GOOD, body=(*GOOD.body, Assignment("e", "cosine", ("a",)))),
        "unknown operation cosine",
    ),
    "too many operands": (
        replace(GOOD, body=(*GOOD.body, Assignment("e", "sin", ("a", "b")))),
        "sin takes 1 operands, not 2",
    ),
    "too few operands": (
        replace(GOOD, body=(*GOOD.body, Assignment("e", "add", ("a",)))),
        "add takes 2 operands, not 1",
    ),
    "load of no argument": (replace(GOOD, loads=(*GOOD.loads, Load("e", "c", 0))), "e is loaded from c"),
    "infinite literal": (replace(GOOD, body=(*GOOD.body, Assignment("e", "add", ("a", math.inf)))), "literal inf"),
    "undefined literal": (replace(GOOD, outputs=("d", math.nan)), "literal nan"),
    "no identifier": (replace(GOOD, loads=(*GOOD.loads, Load("x.y", "y", 1))), "'x.y' cannot name a value"),
    "an expression for a name": (replace(GOOD, body=(*GOOD.body, Assignment("f()", "neg", ("a",)))), "cannot name"),
    "named as an argument": (replace(GOOD, body=(*GOOD.body, Assignment("y", "neg", ("a",)))), "'y' cannot name"),
}


def test_a_good_kernel_passes_the_verifier():
    assert verify(GOOD) is GOOD


@pytest.mark.parametrize("name", MALFORMED)
def test_malformed_kernel_is_refused(name):
    kernel, text = MALFORMED[name]
    with pytest.raises(MalformedKernel) as caught:
        verify(kernel)
    assert text in str(caught.value)
    assert "'rhs'" in str(caught.value)


def test_the_verifier_runs_before_and_after_every_pass():
    def breaking(kernel):
        return replace(kernel, outputs=("lost",))

    with pytest.raises(MalformedKernel, match="lost"):
        run(GOOD, [breaking])
    with pytest.raises(MalformedKernel, match="lost"):
        run(breaking(GOOD), [])
