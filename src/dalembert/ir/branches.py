"""Which operations of a kernel only branches of selections use."""

from __future__ import annotations

from .program import Kernel

__all__ = ["only_in_branches"]

_CHOOSING = ("select", "min", "max")
_JUMPING = ("less", "less_equal", "sign", "floor")


def only_in_branches(kernel: Kernel) -> frozenset[str]:
    """Return the targets that reach an output only through a selection, which may choose otherwise.

    Where it does, what they compute may be singular, and their derivatives count for nothing. What is merely compared
    has no derivative either.
    """
    always = {output for output in kernel.outputs if isinstance(output, str)}
    for line in reversed(kernel.body):
        if line.target in always and line.op not in (*_CHOOSING, *_JUMPING):
            always.update(arg for arg in line.args if isinstance(arg, str))
    return frozenset(line.target for line in kernel.body if line.target not in always)
