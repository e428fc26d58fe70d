"""Long kernels in pieces: functions that pass values to each other in memory, so that compile time grows linearly."""

from __future__ import annotations

from typing import final

from ..frozen import frozen
from ..ir.kernel import Assignment, Kernel, Load, Operand

LONGEST = 6000
"""Lines up to which a kernel is one function: the time of LLVM's code generator grows faster than the lines beyond."""
_PIECE = 150
"""Lines of a piece: pieces of 1,000 take half as long again to compile, and are no faster."""


@final
@frozen
class Piece:
    """A part of a long kernel.

    Attributes
    ----------
    kernel : Kernel
        Of the arguments of the long one and ``kept``, the values passed on.
    places : tuple of int
        Where each output goes in ``kept``; the last piece has the outputs of the long kernel, and no places.
    """

    kernel: Kernel
    places: tuple[int, ...]


def pieces_of(kernel: Kernel, longest: int = LONGEST, size: int = _PIECE) -> tuple[tuple[Piece, ...], int]:
    """Return the pieces of a kernel in their order, and how many values they pass on; none for up to `longest` lines.

    No piece writes to a place that it reads.
    """
    body = kernel.body
    if len(body) <= longest:
        return (), 0
    parts = [body[first : first + size] for first in range(0, len(body), size)]
    home = {line.target: number for number, part in enumerate(parts) for line in part}
    last: dict[str, int] = {}
    for number, part in enumerate(parts):
        for line in part:
            last.update((arg, number) for arg in line.args if isinstance(arg, str) and arg in home)
    last.update((output, len(parts) - 1) for output in kernel.outputs if isinstance(output, str) and output in home)
    loads = {load.target: load for load in kernel.loads}
    ends: list[list[str]] = [[] for _ in parts]
    for name, number in last.items():
        if home[name] < number:
            ends[number].append(name)
    place: dict[str, int] = {}
    free: list[int] = []
    count, made = 0, []
    for number, part in enumerate(parts):
        final_piece = number == len(parts) - 1
        passed = [line.target for line in part if last.get(line.target, number) > number]
        for name in passed:
            if not free:
                free, count = [count], count + 1
            place[name] = free.pop()
        outputs = kernel.outputs if final_piece else tuple(passed)
        made.append(Piece(_part(kernel, number, part, outputs, loads, place), tuple(place[name] for name in passed)))
        free += [place[name] for name in ends[number]]
    return tuple(made), count


def _part(
    kernel: Kernel,
    number: int,
    part: tuple[Assignment, ...],
    outputs: tuple[Operand, ...],
    loads: dict[str, Load],
    place: dict[str, int],
) -> Kernel:
    """Return the kernel of a part, which loads what it uses of arguments and of values passed on."""
    own = {line.target for line in part}
    used = dict.fromkeys(arg for line in part for arg in line.args if isinstance(arg, str) and arg not in own)
    used |= dict.fromkeys(output for output in outputs if isinstance(output, str) and output not in own)
    given = [loads[name] if name in loads else Load(name, "kept", place[name]) for name in used]
    given.sort(key=lambda load: (load.array, load.index or 0))
    return Kernel(f"{kernel.name}_piece{number}", (*kernel.arguments, "kept"), tuple(given), part, outputs)
