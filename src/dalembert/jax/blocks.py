"""Traced functions of kernels that XLA compiles in blocks.

XLA on CPU merges element-by-element operations into one loop for each array that comes out, and repeats in each what
they have in common: time to compile and to run grows faster than the code. Here a long kernel is cut into blocks of
`BLOCK` operations, so that what one block hands to the next is computed once. In what is differentiated, each block
hangs on a condition that is always true and that XLA does not know (`blocked`); barriers alone are gone before it
merges. In steps of a single case a loop takes the blocks in turn, by a switch (`looped`): XLA turns a loop around such
steps into one machine function if an iteration touches less than a kilobyte, and of a switch it counts the largest
branch alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate, pairwise
from typing import Any, final

import jax
import jax.numpy as jnp
from jax import lax

from ..codegen.printers import JAX, JAX_STEPS, Printer
from ..ir.kernel import Assignment, Kernel, Load
from ..transforms.partials import cotangent_kernel
from ..transforms.taylor.nonsmooth import only_in_branches
from .modules import compile_kernel
from .runs.adjoint import Pull
from .runs.mesh_axes import varying_alike, varying_like
from .runs.run_constants import Function, stacked

BLOCK = 12
"""Operations of a block: few enough that little is repeated in it (measured on right-hand sides of chains)."""

LARGEST_WHOLE = 100
"""Operations up to which a kernel is one piece."""

_TURN, _HANDED = 16, 8
"""Most operations of a block that a loop takes in its turn, and most values that it hands on: XLA joins few values in
one fused loop, and a block that is not fused touches more than a kilobyte."""

_GIVEN = "__given"
"""Argument of a block: no value has this name."""


def blocked(kernel: Kernel, printer: Printer = JAX) -> Function:
    """Return the function (t, y, c) of a kernel, in blocks where it is long."""
    if len(kernel.body) <= LARGEST_WHOLE:
        return compile_kernel(kernel, printer)
    chosen = only_in_branches(kernel)
    blocks = [(part.loads, part.outputs, compile_kernel(part, printer, chosen)) for part in _parts(kernel)]

    def run(*arguments: Any) -> tuple[Any, ...]:
        known = _loaded(kernel, arguments)
        for loads, outputs, function in blocks:
            inputs = tuple(jnp.asarray(known[load.target], dtype=float) for load in loads)
            known |= zip(outputs, _held(function, inputs), strict=True)
        return tuple(known.get(output, output) for output in kernel.outputs)

    return run


def looped(kernel: Kernel, printer: Printer = JAX_STEPS) -> Function:
    """Return the function of a kernel of one case, from arrays to an array of its outputs.

    Blocks are taken in turn by a loop. What is read, and what the blocks hand on, lies in one array.
    """
    blocks = _Blocks(kernel, printer)

    def run(*arguments: Any) -> Any:
        values = [jnp.ravel(jnp.asarray(argument, dtype=float)) for argument in arguments]
        places = blocks.places(dict(zip(kernel.arguments, map(len, values), strict=True)))
        memory = blocks.run(places, jnp.concatenate([*values, jnp.zeros(blocks.room)]))
        return jnp.stack([memory[places[o]] if isinstance(o, str) else jnp.asarray(o, float) for o in kernel.outputs])

    return run


def cotangents_of(kernel: Kernel, size: int, constants: int) -> Pull:
    """Return the cotangents of the right-hand side of one case; `size` and `constants` are its numbers of inputs."""
    pulled = cotangent_kernel(kernel, size, constants)
    return (_Whole if len(pulled.body) <= LARGEST_WHOLE else _InBlocks)(pulled, size, constants)


@final
class _Whole:
    """Cotangents in one piece (see `Pull`); the memory is the constants, and the sums of their cotangents."""

    def __init__(self, pulled: Kernel, size: int, constants: int) -> None:
        self._pulled, self._size = stacked(compile_kernel(pulled)), size

    def begin(self, c: Any) -> Any:
        """Return the memory before the first evaluation."""
        return c, jnp.zeros_like(c)

    def __call__(self, memory: Any, t: Any, y: Any, rates: Any) -> tuple[Any, Any]:
        """Return the memory, and the cotangent (n_y,) of a state from that of its rates."""
        c, sums = memory
        found = self._pulled(t, jnp.concatenate([y, rates]), c)
        return (c, sums + found[self._size :]), found[: self._size]

    def sums(self, memory: Any) -> Any:
        """Return the cotangents (n_c,) of the constants."""
        return memory[1]


@final
class _InBlocks:
    """Cotangents in blocks in turn (see `Pull`), on a memory that stays from one evaluation to the next.

    It holds the constants, and the sums of their cotangents where the blocks that add to them put them.
    """

    def __init__(self, pulled: Kernel, size: int, constants: int) -> None:
        self._back, found = pulled.outputs[:size], pulled.outputs[size:]
        sums = {i: f"__sum_{i}" for i, value in enumerate(found) if value != 0.0}
        own = {i: f"__own_{i}" for i in sums}
        added = tuple(Assignment(sums[i], "add", (own[i], found[i])) for i in sums)
        outputs = tuple(output for output in (*self._back, *sums.values()) if isinstance(output, str))
        body = (*pulled.body, *added)
        self._blocks = _Blocks(Kernel(pulled.name, pulled.arguments, pulled.loads, body, outputs), JAX_STEPS)
        self._places = self._blocks.places({"t": 1, "y": 2 * size, "c": constants})
        self._places |= {own[i]: self._places[sums[i]] for i in sums}
        self._sums = [self._places[sums[i]] if i in sums else None for i in range(constants)]
        self._first = 1 + 2 * size

    def begin(self, c: Any) -> Any:
        """Return the memory (room,) before the first evaluation."""
        return jnp.concatenate([jnp.zeros(self._first), c, jnp.zeros(self._blocks.room)])

    def __call__(self, memory: Any, t: Any, y: Any, rates: Any) -> tuple[Any, Any]:
        """Return the memory, and the cotangent (n_y,) of a state from that of its rates."""
        given = jnp.concatenate([jnp.reshape(t, 1), y, rates])
        memory = self._blocks.run(self._places, lax.dynamic_update_slice(memory, given, (0,)))
        return memory, _read(memory, [self._places[value] if isinstance(value, str) else value for value in self._back])

    def sums(self, memory: Any) -> Any:
        """Return the cotangents (n_c,) of the constants."""
        return _read(memory, [0.0 if place is None else place for place in self._sums])


def _read(memory: Any, places: Sequence[int | float]) -> Any:
    """Return values by their places, and literals, side by side."""
    values = [memory[place] if isinstance(place, int) else jnp.asarray(place) for place in places]
    return jnp.stack(values) if values else jnp.zeros(0)


@final
class _Blocks:
    """The blocks of a kernel of one case, which a loop takes in turn on one array.

    Attributes
    ----------
    room : int
        How many places the blocks write to.
    """

    def __init__(self, kernel: Kernel, printer: Printer) -> None:
        self._kernel, self._parts = kernel, _parts(kernel, _cuts(kernel))
        self._width = max((len(part.outputs) for part in self._parts), default=0)
        self._functions = [compile_kernel(part, printer) for part in self._parts]
        self.room = self._width * len(self._parts)

    def places(self, lengths: Mapping[str, int]) -> dict[str, int]:
        """Return the places of values: arguments of these lengths first, then the outputs of the blocks."""
        starts = dict(zip(lengths, accumulate(lengths.values(), initial=0), strict=False))
        places = {load.target: starts[load.array] + (load.index or 0) for load in self._kernel.loads}
        first = sum(lengths.values())
        for number, part in enumerate(self._parts):
            places |= {str(output): first + number * self._width + i for i, output in enumerate(part.outputs)}
        return places

    def run(self, places: Mapping[str, int], memory: Any) -> Any:
        """Return the array after all blocks."""
        width, first = self._width, len(memory) - self.room
        blocks = [
            _on_memory(function, [places[load.target] for load in part.loads], width)
            for function, part in zip(self._functions, self._parts, strict=True)
        ]

        def turn(i: Any, memory: Any) -> Any:
            return lax.dynamic_update_slice(memory, lax.switch(i, blocks, memory), (first + i * width,))

        return lax.fori_loop(0, len(blocks), turn, memory) if blocks else memory


def _on_memory(function: Function, places: list[int], width: int) -> Function:
    """Return a block as a function from the array of all values to its outputs (width,), filled up with zeros."""

    def block(memory: Any) -> Any:
        values = [jnp.asarray(value, dtype=float) for value in function([memory[place] for place in places])]
        return varying_like(jnp.stack(values + [jnp.zeros(())] * (width - len(values))), memory)

    return block


def _loaded(kernel: Kernel, arguments: tuple[Any, ...]) -> dict[Any, Any]:
    """Return the entries of its arguments that a kernel reads, by name."""
    given = dict(zip(kernel.arguments, arguments, strict=True))
    return {
        load.target: given[load.array] if load.index is None else given[load.array][load.index] for load in kernel.loads
    }


def _held(function: Function, inputs: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the outputs of a block, computed under a condition."""

    def block(*values: Any) -> tuple[Any, ...]:
        return varying_like(tuple(jnp.asarray(output, dtype=float) for output in function(values)), values)

    def none(*values: Any) -> tuple[Any, ...]:
        return varying_like(tuple(jnp.zeros(shape.shape) for shape in shapes), values)

    inputs = varying_alike(inputs)
    shapes = jax.eval_shape(block, *inputs)
    go: Any = lax.optimization_barrier(jnp.array(True))  # type: ignore[no-untyped-call]
    found: tuple[Any, ...] = lax.cond(go, block, none, *inputs)
    return found


def _parts(kernel: Kernel, cuts: Sequence[int] | None = None) -> list[Kernel]:
    """Return a kernel in parts of one argument, which holds what a part reads, giving what later parts read.

    Parts begin at the lines `cuts`, or else have `BLOCK` operations each.
    """
    starts = range(0, len(kernel.body), BLOCK) if cuts is None else cuts
    lines = [kernel.body[i:j] for i, j in pairwise((*starts, len(kernel.body)))]
    last = {arg: number for number, part in enumerate(lines) for line in part for arg in line.args}
    last |= dict.fromkeys(kernel.outputs, len(lines))
    return [_part(kernel.name, number, part, last) for number, part in enumerate(lines)]


def _cuts(kernel: Kernel) -> list[int]:
    """Return where blocks begin that hand on at most `_HANDED` values: the longest such, up to `_TURN` operations."""
    last = {arg: i for i, line in enumerate(kernel.body) for arg in line.args}
    last |= dict.fromkeys(kernel.outputs, len(kernel.body))
    ends = [last.get(line.target, -1) for line in kernel.body]
    cuts = [0] if ends else []
    while cuts and cuts[-1] < len(ends):
        start = cuts[-1]
        lengths = (j for j in range(min(start + _TURN, len(ends)), start, -1) if _handed(ends, start, j) <= _HANDED)
        cuts.append(next(lengths))
    return cuts[:-1]


def _handed(ends: Sequence[int], start: int, stop: int) -> int:
    """Return how many values of the lines from start to stop are read behind them."""
    return sum(end >= stop for end in ends[start:stop])


def _part(name: str, number: int, lines: tuple[Assignment, ...], last: dict[Any, int]) -> Kernel:
    own = {line.target for line in lines}
    read = dict.fromkeys(arg for line in lines for arg in line.args if isinstance(arg, str) and arg not in own)
    loads = tuple(Load(value, _GIVEN, i) for i, value in enumerate(read))
    outputs = tuple(line.target for line in lines if last.get(line.target, -1) > number)
    return Kernel(f"{name}_{number}", (_GIVEN,), loads, lines, outputs)
