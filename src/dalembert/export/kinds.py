"""The table of what each kind of export carries; errors and the documentation are made from it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ..errors import CapabilityError, list_names
from ..events.event_code import Event
from ..ir.ops import TABLE_OPERATIONS
from ..runs.capabilities import WITHOUT
from ..transforms.taylor.nonsmooth import decisions

if TYPE_CHECKING:
    from ..model.model import CompiledModel

_EVERY = ("c", "fmu", "page", "wheel", "numba", "jax")
"""Kinds of exports."""

FIXED = "rk4"
"""The method whose steps have a fixed size, which kind "c" has."""

_COMPILED, _ALONE = ("c", "fmu", "page", "wheel"), ("c", "page", "wheel")

LOCKS = "angles that may lock"
MOMENTS = "functions of time with kinks, jumps or pulses"

_TOGETHER = "leave one of them out"
_AS_INPUTS = "make them inputs (add_inputs), which are set during a run, or smooth them"
CARRIED: dict[str, tuple[tuple[str, ...], str]] = {
    "events": (_COMPILED, "leave the events out"),
    "sampled controllers": (_COMPILED, WITHOUT),
    "contacts that change": (_COMPILED, "export one mode, model.mode(...).export(...)"),
    "contacts that change beside events": (_ALONE, _TOGETHER),
    "contacts that change beside sampled controllers": (_ALONE, _TOGETHER),
    "tables": ((*_COMPILED, "numba"), "write the curves as expressions"),
    MOMENTS: (_COMPILED, _AS_INPUTS),
    f"{MOMENTS} beside sampled controllers": (_ALONE, _AS_INPUTS),
    "rates that jump with the state": (_EVERY, "smooth the jumps, as by tanh"),
    LOCKS: (
        (*_COMPILED, "numba", FIXED),
        "give the example (initial=, parameters=) if its motion is regular there",
    ),
}
"""Kinds that carry a feature, `FIXED` among them where its steps do, and the remedy for others."""


def refuse_kind(model: CompiledModel, kind: str, method: str, events: Sequence[Event]) -> None:
    """Reject a model with events of a kind, or of the method `FIXED`, that does not carry what they have.

    Raises
    ------
    CapabilityError
        With what that is, and what carries it.
    """
    column = FIXED if method == FIXED else kind
    for feature, names in _features(model, column, events):
        refuse_feature(feature, column, names)


def refuse_feature(feature: str, kind: str, names: Sequence[str]) -> None:
    """Reject a feature of a scene, and the names of what has it, where a kind or the method `FIXED` does not carry it.

    Raises
    ------
    CapabilityError
    """
    kinds, remedy = CARRIED[feature]
    if kind in kinds:
        return
    others = list_names(repr(other) for other in kinds if other != FIXED)
    if kind == FIXED:
        raise CapabilityError(
            f"method={FIXED!r} does not carry {feature} ({list_names(names)}): its steps do not end where these break"
            f' the motion. Take method="auto", which chooses its steps, with one of the kinds {others}, or {remedy}'
        )
    raise CapabilityError(
        f"kind={kind!r} does not carry {feature} ({list_names(names)}): take one of the kinds {others}, or {remedy}"
    )


def _features(model: CompiledModel, column: str, events: Sequence[Event]) -> Iterator[tuple[str, list[str]]]:
    """Yield the features of a scene with events that count in a column of the table, and the names of what has them."""
    labels, contacts = [event.label for event in events], [] if model.modes is None else list(model.contacts)
    controllers = [item.name for item in model.controllers]
    if contacts:
        yield "contacts that change", contacts
    if labels:
        yield "events", labels
    if controllers:
        yield "sampled controllers", controllers
    if contacts and labels:
        yield "contacts that change beside events", [*contacts, *labels]
    if contacts and controllers:
        yield "contacts that change beside sampled controllers", [*contacts, *controllers]
    if contacts:  # the modes have the rest
        return
    program = model.stages.program
    kernels = [program.kernel("rhs")] if column == FIXED else program
    if any(line.op in TABLE_OPERATIONS for kernel in kernels for line in kernel.body):
        yield "tables", [program.name]
    if program.conditions is not None:
        yield MOMENTS, [program.name]
        if controllers:
            yield f"{MOMENTS} beside sampled controllers", [program.name, *controllers]
    if decisions(program) is not None:
        yield "rates that jump with the state", [program.name]


def table_of_kinds() -> str:
    """Return the table of what kinds carry, in Markdown, for `docs/export.md`."""
    columns = ("c", FIXED, *_EVERY[1:])
    names = [f'`"{kind}"`' if kind != FIXED else f'`method="{FIXED}"`' for kind in columns]
    lines = [f"| | {' | '.join(names)} |", f"|---|{'---|' * len(columns)}"]
    for feature, (kinds, _) in CARRIED.items():
        lines.append(f"| {feature} | {' | '.join('yes' if kind in kinds else 'no' for kind in columns)} |")
    return "\n".join(lines)
