"""How the cost of derivation grows: chains of n rods, beside SymPy's KanesMethod on the planar one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from chains import CHAINS, kane_planar_chain
from measure import Watch, forget, growth_exponent
from sympy import cse

from dalembert.ir.kernel import count_operations
from dalembert.ir.program import Program
from dalembert.lowering.programs import lower
from dalembert.mechanics.derive import derive
from dalembert.reduction import reduce
from dalembert.scene.reading import read

__all__ = ["kane_scaling", "scaling"]

Record = dict[str, Any]
_WORST_GROWTH = 5.5
_ENOUGH_SECONDS = 1.0


def scaling(sizes: Sequence[int], limit: float, say: Callable[[str], None] = print) -> list[Record]:
    """Return one record a chain and size: seconds by stage from scene to program, and operation counts.

    Of many links there is no kernel of the mass matrix.

    A size whose seconds would go beyond `limit`, by the growth between the two sizes before, is left out
    with a record that says so.
    """
    records: list[Record] = []
    for chain, build in CHAINS.items():
        done: list[tuple[int, float]] = []
        for n in sizes:
            expected = _expected(done, n)
            if expected > limit:
                records.append({"chain": chain, "n": n, "left_out": f"expected to take {expected:.0f} s"})
                continue
            record = {"chain": chain, **_median(partial(_derive_chain, build, n))}
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


def _median(measure: Callable[[], Record]) -> Record:
    """Return one of three records, the one with the median total; of a long one there is only one.

    What a process remembers is forgotten before each.
    """
    records: list[Record] = []
    while len(records) < 3 and sum(record["total"] for record in records) < _ENOUGH_SECONDS:
        forget()
        records.append(measure())
    return sorted(records, key=lambda record: record["total"])[len(records) // 2]


def _derive_chain(build: Callable[[int], Any], n: int) -> Record:
    watch = Watch()
    scene = watch("scene", lambda: build(n))
    model = watch("read", lambda: read(scene, ()))
    equations = watch("derive", lambda: derive(model))
    reduced = watch("reduce", lambda: reduce(equations, "auto"))
    program = watch("lower", lambda: lower(reduced))
    return {
        "n": n,
        "seconds": {stage: round(seconds, 5) for stage, seconds in watch.seconds.items()},
        "total": sum(watch.seconds.values()),
        "formulation": program.formulation,
        **{name: _operations(program, name) for name in ("mass_matrix", "rhs") if name in program},
    }


def _operations(program: Program, kernel: str) -> dict[str, int]:
    counts = count_operations(program.kernel(kernel))
    return {"flops": counts["flops"], "sin_cos": counts["sin"] + counts["cos"]}


def kane_scaling(sizes: Sequence[int], say: Callable[[str], None] = print) -> list[Record]:
    """Return one record a size: seconds of KanesMethod on the planar chain, and operations after SymPy's CSE."""
    records = []
    for n in sizes:
        record = _median(partial(_kane_chain, n))
        records.append(record)
        seconds = record["seconds"]
        say(f"  KanesMethod, planar chain of {n}: {seconds['equations']:.2f} s, and {seconds['cse']:.2f} s of CSE")
    return records


def _kane_chain(n: int) -> Record:
    watch = Watch()
    kane = watch("equations", lambda: kane_planar_chain(n))
    shared, (mass, forcing) = watch("cse", lambda: cse([kane.mass_matrix, kane.forcing]))
    entries = [expression for _, expression in shared] + [*mass, *forcing]
    return {
        "n": n,
        "seconds": {stage: round(seconds, 5) for stage, seconds in watch.seconds.items()},
        "total": sum(watch.seconds.values()),
        "operations": sum(int(expression.count_ops()) for expression in entries),
    }
