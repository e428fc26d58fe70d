"""The verifier refuses whatever is not in SSA form."""

import math
from dataclasses import replace

import pytest

from dalembert.ir.kernel import Assignment, Kernel, Load, MalformedKernel, verify

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
