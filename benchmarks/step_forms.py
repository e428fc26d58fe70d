"""Taylor steps of one case: written out with operations in pairs, and as a loop over the orders.

``python benchmarks/step_forms.py`` prints, for the hard cases and orders 10, 14 and 19, the time of the first form over
that of the second, by the lines of the first, and the seconds of compilation of both.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path

import numpy as np
from bound import chained, stepping

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import dalembert as da
from dalembert.codegen.llvm.assembly import assembly, compile_object, load_object
from dalembert.codegen.llvm.definitions import with_definitions
from dalembert.codegen.llvm.order_loops import order_loop_assembly
from dalembert.codegen.llvm.target import native_lanes
from dalembert.starts.inputs import constants
from dalembert.transforms.taylor.recurrences import recurrences
from dalembert.transforms.taylor.step import paired_step
from hard_cases import CASES, hard_case

ORDERS, LARGEST, ROUNDS = {10: 1e-6, 14: 1e-9, 19: 1e-12}, 9000, 60


def rows(name: str) -> list[tuple[int, str]]:
    """Return lines and the text of a row for each order."""
    case = hard_case(name)
    model = da.compile_model(case.scene)
    program, found = model.stages.program, []
    known = recurrences(program.kernel("rhs"))
    y = model.state(case.initial, case.parameters)
    c = constants(program, model.parameter_vector(case.parameters))
    for order, rtol in ORDERS.items():
        lines = known.unrolled_lines(order)
        if lines > LARGEST:
            continue
        kernel, pairs = paired_step(known, order, dense=False)
        texts = [
            assembly([("step", kernel)], 1, pairs=pairs),
            order_loop_assembly("step", known, order, 1, native_lanes(), dense=False),
        ]
        tasks, compiled, codes = [], [], []
        for text in texts:
            begin = time.perf_counter()
            code = load_object(compile_object(with_definitions(text)))
            compiled.append(time.perf_counter() - begin)
            codes.append(code)  # the loops below have its bare address
            tasks.append(stepping(chained, code.address("step"), y, c, rtol, 1))
        least = [math.inf] * len(tasks)
        for _ in range(ROUNDS):
            least = [min(before, task()) for before, task in zip(least, tasks, strict=True)]
        times = (
            f"{least[0] / least[1]:.2f} of {1e9 * least[1]:.0f} ns, compiled in {compiled[0]:.2f}, {compiled[1]:.2f} s"
        )
        found.append((lines, f"{lines} lines, order {order}, {name}: {times}"))
    return found


def main() -> None:
    """Print the rows by their lines; cases without a start or a series are left out."""
    found = []
    for name in CASES:
        try:
            found += rows(name)
        except (da.DalembertError, np.linalg.LinAlgError) as reason:
            print(f"{name}: left out, {type(reason).__name__}", flush=True)
    print("\n".join(text for _, text in sorted(found)))


if __name__ == "__main__":
    main()
