"""The start of single runs as compiled code: every operation has the bits of the interpreter."""

import numpy as np
import pytest

import dalembert as da
from dalembert.ir.interpret import interpret
from dalembert.ir.kernel import Assignment, Kernel, Load
from dalembert.ir.ops import OPERATIONS
from dalembert.reduction.starting import Start

LOADS = tuple(Load(f"y_{i}", "y", i) for i in range(3))
BODY = tuple(
    Assignment(f"o_{name}", name, tuple(load.target for load in LOADS[: operation.arity]))
    for name, operation in OPERATIONS.items()
)
START = Start(Kernel("start", ("t", "y", "c"), LOADS, BODY, tuple(line.target for line in BODY)), ("a", "b", "c"), ())


def test_every_operation_has_the_bits_of_the_interpreter():
    model = da.compile_model(da.scenes.chaplygin_sleigh())
    code, p = model.engine.start_code(START), np.ones(len(model.layout.parameters))
    rng = np.random.default_rng(0)
    for trial in range(2000):
        y = rng.standard_normal(3) * 10.0 ** rng.integers(-8, 4)
        y = np.abs(y) if trial % 3 == 0 else np.clip(y, -1.0, 1.0) if trial % 3 == 1 else y
        expected = interpret(START.kernel, {"t": 0.0, "y": y.tolist(), "c": p.tolist()})
        _, found = code(0.0, p, y.tolist())
        assert np.array_equal(found, expected, equal_nan=True), dict(
            zip(OPERATIONS, zip(found, expected, strict=True), strict=True)
        )


@pytest.mark.parametrize("backend", ["numpy", "numba"])
def test_backends_that_compile_slowly_interpret_starts(backend):
    model = da.compile_model(da.scenes.chaplygin_sleigh(), backend=backend)
    assert model.engine.start_code(START) is None
