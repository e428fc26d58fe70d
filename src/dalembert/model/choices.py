"""The mode and the method that calls of a model take, and the functions that its backend offers."""

from __future__ import annotations

from collections.abc import Callable
from types import MethodType
from typing import TYPE_CHECKING, Any, cast, final

from ..codegen import backend_named
from ..codegen.base import Capability
from ..errors import CapabilityError, OptionError, list_names, unknown_name
from ..options import tolerances
from ..runs.capabilities import require
from ..runs.component_tolerances import with_names

if TYPE_CHECKING:
    from ..codegen.engine import FunctionEngine, TracedEngine
    from ..contacts.equations.contact_laws import Mode
    from .model import CompiledModel

_MOST_CHOSEN = 64
"""Tolerances for which the method that "auto" takes is remembered."""


@final
class OfOneMode:
    """Method that models with several modes do not have: their `__getattr__` raises the error."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function, self.__doc__ = function, function.__doc__

    def __get__(self, model: CompiledModel | None, owner: type) -> Any:
        if model is None:
            return self.function
        if model.modes is not None:
            raise AttributeError
        return MethodType(self.function, model)


def mode(self: CompiledModel, **states: str) -> CompiledModel:
    """Return the model of one mode: an ordinary one, without events; the model itself where it has one mode.

    Parameters
    ----------
    **states : str
        For each contact "slip", "stick", "closed" or "open"; contacts that are left out slip, or are closed. A name
        with a dot is given as ``model.mode(**{"stop.upper": "open"})``.
        Directions of slip are further parameters of the model, see ``layout.parameters``.

    Raises
    ------
    OptionError
        For contacts that do not exist, and states that they do not have: a further law of friction of a contact is open
        where that is, and then only.
    """
    unknown = [name for name in states if name not in self.contacts]
    if unknown:
        raise OptionError(f"no contact is called {list_names(map(repr, unknown))}; known: {list_names(self.contacts)}")
    chosen = []
    for i, contact in enumerate(self.contacts):
        able = (cast("Mode", self.stages.mode)[i],) if self.modes is None else self.modes.automaton.states(i)
        state = states.get(contact, able[0])
        if state not in able:
            raise OptionError(f"contact {contact!r} cannot be {state!r}; it can be: {list_names(able)}")
        chosen.append(state)
    if self.modes is None:
        return self
    whole = self.modes.automaton.with_followers(tuple(chosen))
    rows = self.modes.automaton.contacts
    for row, state in zip(rows, whole, strict=True):
        asked, leader = states.get(row.name, state), None if row.leader is None else row.leader
        if leader is not None and (asked != state or (state == "open") != (whole[leader] == "open")):
            raise OptionError(
                f"{row.name!r} is a law of friction of {rows[leader].name!r}: one is open where the other is"
            )
    return self.modes.model(whole)


def missing(model: CompiledModel, name: str) -> str:
    """Return the message of an attribute that a model does not have, or only the models of its modes."""
    hint, known = "", name in type(model).__annotations__ or hasattr(type(model), name)
    if known and not name.startswith("_") and (modes := model.__dict__.get("modes")) is not None:
        hint = (
            f" of its own, because its contacts change what it is; ask the model of one mode, such as"
            f" model.mode().{name}, or model.mode({modes.automaton.example}).{name}"
        )
    return f"a {type(model).__name__} has no {name!r}{hint}"


def source_of(self: CompiledModel, method: str = "auto", rtol: float = 1e-8, atol: Any = 1e-10) -> str:
    """Return the generated code that `simulate` runs by a method at some tolerances.

    Raises
    ------
    OptionError
        For a method that the backend does not have, or tolerances that are not positive.
    """
    rtol, atol = tolerances(rtol, atol)
    atol = with_names(self, atol)
    return self.engine.source_of(choose_method(self, method, rtol, atol), rtol, atol) or self.source


def choose_method(self: CompiledModel, method: Any, rtol: float, atol: float, *, many: bool = False) -> str:
    """Return the method that a run takes, checked; `many` says whether it is to run many cases at once.

    Raises
    ------
    OptionError
        For a method that the model does not have, with those that it has.
    """
    if isinstance(method, str) and method == "auto":
        key = rtol, atol, many
        found = self.chosen.get(key)
        if found is None:
            if len(self.chosen) >= _MOST_CHOSEN:
                self.chosen.clear()
            found = self.chosen[key] = self.engine.automatic(self.methods, rtol, atol, many=many)
        return found
    if isinstance(method, str) and method in self.method_descriptions:
        return method
    why = backend_named(self.backend).refusal(self.stages.program, str(method))
    if why:
        raise OptionError(f"{why}. Take one of: {list_names(['auto', *self.methods])}")
    raise OptionError(
        unknown_name("method", str(method), ["auto", *self.methods]) + f" (of the backend {self.backend!r})"
    )


def kernels(self: CompiledModel) -> Any:
    """Return the generated kernels as functions of numba, by name, for people's own compiled code (backend "numba").

    ``prepare(p, c)`` computes constants c (``layout.constants``,) from parameters p (n_p,), ``rhs(t, y, c, out)``
    the rate of the state, and so on: see `source`. numba compiles each when it is first called.

    Raises
    ------
    CapabilityError
        For another backend, for scenes whose functions of time a run takes piece by piece, and for several modes.
    """
    if self.modes is not None:
        raise CapabilityError(f"{self.name!r} has kernels for each mode of its contacts: see mode(...).kernels")
    require(self.backend, self.stages.program, Capability.KERNEL_FUNCTIONS)
    return cast("FunctionEngine", self.engine).functions


def functions(self: CompiledModel) -> Any:
    """Return pure functions of (t, y, p) that JAX traces, vectorises and differentiates, for the backend "jax".

    They are `expand`, `outputs`, `energy`, `mass_matrix`, `forcing`, `constraint_jacobian`, `accelerations` and
    `project`; t is a time, y (n_y,) a state, p a mapping of parameters and inputs to scalars, or an array as of
    `parameter_vector`.

    Raises
    ------
    CapabilityError
        For a backend other than "jax".
    """
    require(self.backend, self.stages.program, Capability.STATE_FUNCTIONS)
    return cast("TracedEngine", self.engine).state_functions
