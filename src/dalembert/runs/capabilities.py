"""Errors for calls that a backend or a scene does not support."""

from __future__ import annotations

from collections.abc import Sequence

from ..codegen import backend_named
from ..codegen.base import Capability
from ..errors import CapabilityError, list_names
from ..ir.program import Program
from ..scene.model import ControllerModel

WITHOUT = "compile the scene without them, copy() of it before add_controllers, so that their inputs are given"


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
    """Reject a call that a program on a backend does not support.

    Raises
    ------
    CapabilityError
        With the reason and the remedy.
    """
    why = refusal(backend, program, capability)
    if why:
        raise CapabilityError(why)


def refuse_functions(controllers: Sequence[ControllerModel], what: str) -> None:
    """Reject a call that does not support Python functions.

    Raises
    ------
    CapabilityError
        Naming the controllers, with the remedy.
    """
    names = [item.name for item in controllers if item.function is not None]
    if names:
        raise CapabilityError(
            f"{what} calls no Python functions, and the laws of controller {list_names(names)} are one: write them as"
            " expressions, Controller(states={...}, inputs={...}), or call simulate for each run"
        )


def refuse_sampling(controllers: Sequence[ControllerModel], what: str, remedy: str) -> None:
    """Reject a call that does not support controllers.

    Raises
    ------
    CapabilityError
    """
    if controllers:
        names = list_names(item.name for item in controllers)
        raise CapabilityError(f"{what} does not support sampled controllers ({names}): {remedy}")
