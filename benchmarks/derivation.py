"""How the cost of derivation grows: chains of n rods, beside SymPy's KanesMethod on the planar one."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from chains import CHAINS, kane_planar_chain
from measure import Watch, growth_exponent

from dalembert.ir.lower import lower
from dalembert.ir.program import Program, count_operations
from dalembert.mechanics.derive import derive
from dalembert.reduction import reduce
from dalembert.scene.reading import read

__all__ = ["kane_scaling", "scaling"]

Record = dict[str, Any]
_WORST_GROWTH = 5.5


def scaling(sizes: Sequence[int], limit: float, say: Callable[[str], None] = print) -> list[Record]:
    """Return one record a chain and size: seconds by stage from scene to program, and operation counts.

    A size whose seconds would go beyond `limit`, by the growth between the two sizes before, is left out
    with a record that says so.
    """
    records = []
    for chain, build in CHAINS.items():
        done: list[tuple[int, float]] = []
        for n in sizes:
            expected = _expected(done, n)
            if expected > limit:
                records.append({"chain": chain, "n": n, "left_out": f"expected to take {expected:.0f} s"})
                continue
            record = _derive_chain(chain, build, n)
            done.append((n, record["total"]))
            records.append(record)
            say(f"  {chain} chain of {n}: {record['total']:.2f} s, rhs {record['rhs']['flops']} flops")
    return records


def _expected(done: Sequence[tuple[int, float]], n: int) -> float:
    """Return the seconds to expect at size `n` from those at the sizes before."""
    if not done:
        return 0.0
    exponent = growth_exponent(*zip(*done[-2:], strict=True)) or 1.0
    size, seconds = done[-1]
    return float(seconds * (n / size) ** min(exponent, _WORST_GROWTH))


def _derive_chain(chain: str, build: Callable[[int], Any], n: int) -> Record:
    watch = Watch()
    scene = watch("scene", lambda: build(n))
    model = watch("read", lambda: read(scene, ()))
    equations = watch("derive", lambda: derive(model))
    reduced = watch("reduce", lambda: reduce(equations, "auto"))
    program = watch("lower", lambda: lower(reduced))
    return {
        "chain": chain,
        "n": n,
        "seconds": {stage: round(seconds, 5) for stage, seconds in watch.seconds.items()},
        "total": sum(watch.seconds.values()),
        "formulation": program.formulation,
        "mass_matrix": _operations(program, "mass_matrix"),
        "rhs": _operations(program, "rhs"),
    }


def _operations(program: Program, kernel: str) -> dict[str, int]:
    counts = count_operations(program.kernel(kernel))
    return {"flops": counts["flops"], "sin_cos": counts["sin"] + counts["cos"]}


def kane_scaling(sizes: Sequence[int], say: Callable[[str], None] = print) -> list[Record]:
    """Return one record a size: seconds of KanesMethod on the planar chain, and operations after SymPy's CSE."""
    from sympy import cse

    records = []
    for n in sizes:
        begin = time.perf_counter()
        kane = kane_planar_chain(n)
        formed = time.perf_counter()
        shared, (mass, forcing) = cse([kane.mass_matrix, kane.forcing])
        shared_at = time.perf_counter()
        entries = [expression for _, expression in shared] + [*mass, *forcing]
        operations = sum(int(expression.count_ops()) for expression in entries)
        seconds = {"equations": round(formed - begin, 5), "cse": round(shared_at - formed, 5)}
        records.append({"n": n, "seconds": seconds, "total": shared_at - begin, "operations": operations})
        say(f"  KanesMethod, planar chain of {n}: {formed - begin:.2f} s, and {shared_at - formed:.2f} s of CSE")
    return records
