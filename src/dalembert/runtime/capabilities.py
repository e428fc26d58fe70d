"""What a compiled model can do beyond simulation: declared by backends, limited by scenes, looked up before use."""

from __future__ import annotations

from ..codegen import backend_named
from ..codegen.base import Capability
from ..errors import CapabilityError
from ..ir.program import Program

__all__ = ["refusal", "require"]


def refusal(backend: str, program: Program, capability: Capability) -> str:
    """Return why a program on a backend lacks a capability; nothing where it has it."""
    if capability not in backend_named(backend).capabilities:
        return capability.value
    conditions = program.conditions
    if capability is Capability.KERNEL_FUNCTIONS and conditions is not None and conditions.decides:
        return (
            f"{program.name!r} has no model.kernels: its functions of time have kinks or jumps, and a run decides"
            " from piece to piece which branch holds. Use simulate, sweep or prepare"
        )
    return ""


def require(backend: str, program: Program, capability: Capability) -> None:
    """Refuse what a program on a backend cannot do.

    Raises
    ------
    CapabilityError
        With the reason and the remedy.
    """
    why = refusal(backend, program, capability)
    if why:
        raise CapabilityError(why)
