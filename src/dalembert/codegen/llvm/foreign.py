"""Runs that XLA calls: a handler in machine code, which hands the buffers of a call to a compiled loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from ...integrators.addresses import OwnedAddress
from ...integrators.arguments import pack, place_of
from ...integrators.foreign_loop import ForeignArguments
from ...integrators.prepared_loop import PreparedArguments, PreparedKernels, PreparedLimits, PreparedProgress
from ...integrators.stops import no_stops
from ..rendering import render
from .assembly import compile_object, load_object
from .loops import compiled_entry

__all__ = ["ForeignCode", "buffer", "foreign_arguments", "foreign_code", "handler_assembly"]

_WORD = 8


@final
@dataclass(frozen=True, eq=False)
class ForeignCode:
    """A handler of XLA's interface for foreign functions.

    Its arguments are times (n_t,), first state (n_y,) and constants (n_c,), its results the last state (n_y,), numbers
    (5,) and rows, as `dalembert.integrators.foreign_loop` has them, and memory.

    Attributes
    ----------
    address : OwnedAddress
        The handler.
    memory : int
        Length of the last result, of batches for each thread.
    held : tuple
        The arguments that it has copied, and the code that it calls.
    """

    address: OwnedAddress
    memory: int
    held: tuple[Any, ...]


def foreign_code(
    kernels: PreparedKernels,
    sizes: tuple[int, int, int],
    reads: Sequence[float],
    limits: tuple[float, int],
    version: tuple[int, int],
) -> ForeignCode:
    """Return the handler of runs by the same steps and limits.

    Parameters
    ----------
    kernels : PreparedKernels
    sizes : (int, int, int)
        Number of components of the state, of constants, and of what a step remembers.
    reads : sequence of float
        What a step reads behind the largest step and the direction of time.
    limits : (float, int)
        Largest step, and number of attempts.
    version : (int, int)
        Of XLA's interface.
    """
    arguments, entry = foreign_arguments(kernels, sizes, np.array(reads), limits), compiled_entry("foreign_loop")
    text, memory = handler_assembly(arguments, version, entry)
    return ForeignCode(load_object(compile_object(text)).address("handler"), memory, (arguments, entry))


def handler_assembly(arguments: ForeignArguments, version: tuple[int, int], entry: int) -> tuple[str, int]:
    """Return a handler in assembly that calls the loop at an address, and the length of the memory that it needs.

    What lies in buffers of a call is taken from there, and the rest from `arguments`.
    """
    parts, used = [], 0
    for field in ("states", "settings", "clock", "delta", "mark"):
        parts.append({"word": _place(f"run.{field}"), "offset": _WORD * used})
        used += getattr(arguments.run, field).size
    parts.append({"word": _place("run.progress"), "offset": _WORD * used})
    used += len(arguments.run.progress.words)
    times, rows = _place("times"), _place("rows")
    buffers = [
        buffer("times", "given", 0, [times], [times + 1]),
        buffer("start", "given", 1, [_place("start")], []),
        buffer("constants", "given", 2, [_place("run.constants")], []),
        buffer("end", "results", 0, [_place("end")], []),
        buffer("numbers", "results", 1, [_place("numbers")], []),
        buffer("rows", "results", 2, [rows], [rows + 1, rows + 2]),
        {**buffer("memory", "results", 3, [], []), "parts": parts},
    ]
    words = pack(arguments).tolist()
    variables = {
        "words": words,
        "count": len(words),
        "size": _WORD * len(words),
        "version": {"major": version[0], "minor": version[1]},
        "buffers": buffers,
        "first": _place("run.limits.t0"),
        "last": _place("run.limits.t1"),
        "entry": entry,
    }
    return render("llvm/foreign_handler.ll.j2", variables), used


def _place(field: str) -> int:
    return place_of(ForeignArguments, field)


def buffer(name: str, side: str, number: int, words: Sequence[int], lengths: Sequence[int]) -> dict[str, Any]:
    """Return the template's variables of a buffer: the places of its address and of its lengths."""
    return {
        "name": name,
        "side": side,
        "number": number,
        "parts": [{"word": word, "offset": 0} for word in words],
        "lengths": lengths,
    }


def foreign_arguments(
    kernels: PreparedKernels, sizes: tuple[int, int, int], reads: Any, limits: tuple[float, int]
) -> ForeignArguments:
    """Return the arguments of the loop with arrays of the right lengths; what they hold lies in buffers of the call."""
    n, n_c, memory = sizes
    largest, attempts = limits
    run = PreparedArguments(
        kernels=kernels,
        limits=PreparedLimits(0.0, 0.0, largest, attempts, attempts, going=False, slack=1.0),
        n=n,
        memory=memory,
        parameters=np.zeros((1, 0)),
        constants=np.zeros((n_c, 1)),
        settings=np.zeros((1, 2 + len(reads))),
        clock=np.zeros((1, 1)),
        states=np.zeros((2, n + 2 + memory)),
        times=np.zeros(0),
        low=np.zeros(0),
        delta=np.zeros((n, 1)),
        mark=np.zeros(1, np.int64),
        tests=np.zeros((0, 1)),
        progress=PreparedProgress(),
        stops=no_stops(),
    )
    none = np.zeros(0)
    return ForeignArguments(run, reads, np.zeros(n), none, np.zeros(n), np.zeros(5), np.zeros((0, 0)))
