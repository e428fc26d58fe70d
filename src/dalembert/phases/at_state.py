"""Linearisations and equilibria of scenes with contacts, in the mode that a state decides."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..analysis.linearize import linearize
from ..analysis.trim import find_operating_point
from ..arrays import FloatArray
from ..contacts.contact_cases import ADDED
from ..contacts.equations.contact_laws import Mode
from ..errors import InitialStateError
from ..ir.conditions import CONDITION_TIME
from ..options import TrimOptions
from ..results.analyses import OperatingPoint
from ..results.linearization import Linearization
from ..starts import inputs as run_input
from ..starts.assembly import assembled_by
from ..starts.inputs import with_inputs
from .given_values import start_state
from .mode_models import ModeModels, all_modes

if TYPE_CHECKING:
    from ..model.model import CompiledModel

_MOST_MODES = 8
"""Modes in which an equilibrium is looked for, one after the other."""


def linearize_mode(
    model: CompiledModel,
    t: float,
    initial: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
    states: Sequence[str] | None,
    outputs: Iterable[Any] | None,
) -> Linearization:
    """Return the linearisation about a state; see `CompiledModel.linearize`.

    Raises
    ------
    InitialStateError
        For states that the contacts forbid, or from which no motion continues.
    """
    modes, values = all_modes(model), run_input.given_values(model.layout, initial)
    given = run_input.named_parameters(model, parameters)
    mode, x, given = _decided_mode(modes, t, start_state(modes, t, values, given), given)
    start = dict(zip(model.layout.variables, x.tolist(), strict=True))
    return linearize(modes.model(mode), t, start, given, states, outputs)


def assemble_open(
    model: CompiledModel, t: float, guess: dict[str, float], parameters: Mapping[Any, Any], fixed: Collection[str]
) -> dict[str, float]:
    """Return consistent values near a guess; see `CompiledModel.assemble`.

    Contacts are closed one by one, as it penetrates.

    Raises
    ------
    InitialStateError
        For what cannot be assembled.
    """
    modes, given = all_modes(model), run_input.named_parameters(model, parameters)
    slipping = modes.closed_mode
    mode, found = modes.open_mode, guess
    for _ in range(len(mode) + 1):
        found_gaps = _gaps(modes, t, found, given)
        deep = np.ones(len(mode), np.bool_) if found_gaps is None else found_gaps[0] < -found_gaps[1]
        mode = tuple(s if closes else m for m, s, closes in zip(mode, slipping, deep, strict=True))
        found = assembled_by(modes.model(mode), t, guess, given | _no_slip(modes, mode), fixed)
        if not _penetrates(modes, t, found, given):
            break
    return found


def trim_mode(
    model: CompiledModel, guess: Mapping[Any, Any], parameters: Mapping[Any, Any], options: TrimOptions
) -> OperatingPoint:
    """Return an equilibrium or a steady motion; see `CompiledModel.trim`.

    It is looked for in the mode that the guess decides. Where the contacts are in another mode at what is found, this
    is the guess for that one.

    Raises
    ------
    InitialStateError
        For guesses that the contacts forbid, or from which no motion continues.
    """
    modes, layout, t = all_modes(model), model.layout, options.t
    values = run_input.guessed_values(layout, model.equations.symbols.entries, guess)
    values, mode, own = _on_contacts(modes, t, values, run_input.named_parameters(model, parameters))
    for _ in range(_MOST_MODES):
        found = find_operating_point(modes.model(mode), values, own, options)
        point = replace(
            found,
            message=f"{found.message} ({_mode_text(modes, mode)})",
            parameters={name: found.parameters[name] for name in layout.given},
            aliases=layout.aliases,
        )
        if not point.converged:
            return point
        values = {name: point.initial[name] for name in values}
        given = run_input.named_parameters(model, with_inputs(layout, model.inputs, point.inputs, point.parameters, t))
        try:
            if _penetrates(modes, t, values, given):
                values, after, own = _on_contacts(modes, t, values, given)
            else:
                x = np.array([point.initial[name] for name in layout.variables])
                after, _, own = _decided_mode(modes, t, x, given)
        except InitialStateError as reason:
            return replace(point, converged=False, message=f"{point.message}, but the contacts forbid it: {reason}")
        if after == mode:
            return point
        mode = after
    message = f"{point.message}, but there the mode is another, {_mode_text(modes, mode)}, and so on: start elsewhere"
    return replace(point, converged=False, message=message)


def _on_contacts(
    modes: ModeModels, t: float, values: dict[str, float], given: dict[str, float]
) -> tuple[dict[str, float], Mode, dict[str, float]]:
    """Return a rough guess moved onto what it touches, the mode that it decides, and the parameters of its model.

    Raises
    ------
    InitialStateError
        For guesses that the contacts forbid, or from which no motion continues.
    """
    slipping, opened = modes.closed_mode, modes.open_mode
    gaps = _gaps(modes, t, values, given)
    apart = np.zeros(len(opened), np.bool_) if gaps is None else gaps[0] > gaps[1]
    touching = modes.automaton.with_followers(
        tuple(o if far else s for s, o, far in zip(slipping, opened, apart, strict=True))
    )
    values = values | modes.model(touching).assemble(values, given | _no_slip(modes, touching), t=t)
    mode, _, own = _decided_mode(modes, t, start_state(modes, t, values, given), given)
    return values, mode, own


def _gaps(
    modes: ModeModels, t: float, values: Mapping[str, float], given: Mapping[str, float]
) -> tuple[FloatArray, FloatArray] | None:
    """Return the gaps (n_contacts,) at a guess, and what counts as zero; None where it lacks coordinates."""
    layout = modes.layout
    if any(name not in values for name in layout.coordinates):
        return None
    x = np.array([[values.get(name, 0.0) for name in layout.variables]])
    c = np.array([[given[name] for name in layout.parameters]])
    return modes.decisions.gaps(np.array([t]), x, c)


def _penetrates(modes: ModeModels, t: float, values: Mapping[str, float], given: Mapping[str, float]) -> bool:
    """Whether a contact that can open has a gap below zero."""
    gaps = _gaps(modes, t, values, given)
    return gaps is not None and bool(np.any(gaps[0] < -gaps[1]))


def _decided_mode(
    modes: ModeModels, t: float, x: FloatArray, given: Mapping[str, float]
) -> tuple[Mode, FloatArray, dict[str, float]]:
    """Return the mode that variables x (2 n_q + n_z,) decide, with the variables and the parameters of its model.

    Raises
    ------
    InitialStateError
        For states that the contacts forbid, or from which no motion continues.
    """
    values = dict(given)
    if CONDITION_TIME in values:
        values[CONDITION_TIME] = t
    p = np.array([[values[name] for name in modes.layout.parameters]])
    cases = modes.decisions.at_states(np.array([t]), x[np.newaxis], p, "no motion continues from")
    mode = modes.automaton.mode(int(cases.number[0]))
    added = modes.added(mode, cases.added[0])
    return mode, cases.x[0], values | {name: float(value) for name, value in added.items()}


def _no_slip(modes: ModeModels, mode: Mode) -> dict[str, float]:
    """Return parameters of the model of a mode for positions alone, which do not depend on them."""
    return {name: 0.0 for name in modes.added(mode, np.zeros(ADDED * len(mode)))}


def _mode_text(modes: ModeModels, mode: Mode) -> str:
    return ", ".join(f"{name}: {state}" for name, state in modes.named(mode).items())
