"""Methods of models that make parameters and states: vectors from values by name, consistent starts, assembly."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import FloatArray
from ..errors import ValueInputError, nesting_named
from ..ir.interpret import interpret_rows
from ..ir.program import coefficient_places, hidden_parameters
from ..starts import inputs as run_input
from ..starts.initial_states import initial_state
from ..starts.input_values import read_inputs
from ..starts.inputs import with_inputs
from ..starts.segment_constants import at_time
from ..values import option
from .rows import rows_of

if TYPE_CHECKING:
    from .model import CompiledModel


@nesting_named
def parameter_vector(
    self: CompiledModel, parameters: Mapping[Any, Any], *, inputs: Mapping[Any, Any] | None = None
) -> FloatArray:
    """Return p (n_p,) in the order of ``layout.parameters`` from a mapping of names or symbols to numbers.

    It ends with what stands for the inputs, with the numbers `inputs`; without these it is NaN, for a prepared run
    that is given inputs with each call.

    Raises
    ------
    UnknownNameError, ValueInputError
        For input that is wrong, and for samples, which change along a run.
    """
    given = read_inputs(self.layout, self.inputs, inputs) if inputs is not None else None
    if given is not None and given.sampled:
        raise ValueInputError(
            "parameter_vector takes numbers as inputs, because it holds for a whole run, and samples change along"
            " one: give samples to simulate, sweep or prepare(t_span, inputs=...)"
        )
    if given is not None:
        return run_input.in_order(self.layout, self.read_parameters(given.parameters(parameters, 0.0)))
    if not self.layout.inputs or hidden_parameters(self.layout.inputs[0])[0] in parameters:
        return run_input.in_order(self.layout, self.read_parameters(parameters))
    free = dict.fromkeys((hidden for u in self.layout.inputs for hidden in hidden_parameters(u)), 0.0)
    p = run_input.in_order(self.layout, self.read_parameters({**parameters, **free}))
    for place in coefficient_places(self.layout.parameters, self.layout.inputs):
        p[place + 1] = np.nan
    return p


def initial_values(self: CompiledModel, initial: Mapping[Any, Any]) -> dict[str, float]:
    """Return initial values by name from a mapping of names or symbols to numbers.

    Raises
    ------
    UnknownNameError, ValueInputError
        For unknown names, and values that are not finite numbers or that their symbols exclude.
    """
    return self.read_initial(initial)


@nesting_named
def state(
    self: CompiledModel,
    initial: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
    *,
    t: float = 0.0,
    inputs: Mapping[Any, Any] | None = None,
) -> FloatArray:
    """Return the state y (n_y,) of the formulation at consistent initial values, as `simulate` starts from it.

    In scenes with contacts it is coordinates, rates and first-order states (2 n_q + n_z,).
    """
    time = option("t", t)
    given = with_inputs(self.layout, self.inputs, inputs, parameters, time)
    if self.modes is not None:
        from ..phases.given_values import start_state

        values = run_input.given_values(self.layout, initial)
        return start_state(self.modes, time, values, run_input.named_parameters(self, given))
    program, values = self.stages.program, self.initial_values(initial)
    c = run_input.constants(program, self.parameter_vector(given))
    return initial_state(self.derived.start(values), time, values, at_time(program, c, time), program)


def expand(
    self: CompiledModel,
    t: float,
    y: FloatArray,
    parameters: Mapping[Any, Any],
    *,
    inputs: Mapping[Any, Any] | None = None,
) -> FloatArray:
    """Return coordinates, rates and states (2 n_q + n_z,) of a state y (n_y,) of the formulation at time t."""
    program, time = self.stages.program, option("t", t)
    given = with_inputs(self.layout, self.inputs, inputs, parameters, time)
    c = run_input.constants(program, self.parameter_vector(given))
    state = rows_of("y", y, len(self.layout.state))
    c = at_time(program, c, time)
    return interpret_rows(program.kernel("expand"), np.array([time]), state[np.newaxis], c)[0]


@nesting_named
def assemble(
    self: CompiledModel,
    guess: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
    *,
    t: float = 0.0,
    inputs: Mapping[Any, Any] | None = None,
    fixed: Iterable[Any] = (),
) -> dict[str, float]:
    """Return the consistent initial values nearest to a rough guess, for `simulate`.

    Parameters
    ----------
    guess : mapping of symbols or names to numbers
        Every coordinate, roughly. Rates may be given too; those that the constraints fix may be left out.
    parameters : mapping of symbols or names to numbers
        Every parameter of the scene.
    t : float
        Time [s], where constraints depend on it.
    inputs : mapping of symbols or names to numbers or samples, optional
        Every input of the scene.
    fixed : iterable of symbols or names
        Names that keep exactly the value of the guess, such as the angle of a crank.

    Returns
    -------
    dict of str to float
        Coordinates, rates where the guess has any, and the states as they are given. Nearest is meant by the sum
        of the squares of the changes, those of lengths beside angles over the radius of gyration (the square root of
        the sum of the diagonal entries of the mass matrix for angles over that for lengths, at the guess). Contacts
        that the guess penetrates are closed, and others may stay open: ask the model of one mode, as
        ``mode(floor="slip").assemble``, for what is to touch.

    Raises
    ------
    InitialStateError
        When the loops cannot close, with the residual of each constraint at the best position found.
    UnknownNameError, ValueInputError
        For input that is wrong.
    """
    time = option("t", t)
    given = with_inputs(self.layout, self.inputs, inputs, parameters, time)
    values = run_input.guessed_values(self.layout, self.equations.symbols.entries, guess)
    held = run_input.resolve_names("fixed name", fixed, values, self.layout.aliases)
    if self.modes is not None:
        from ..phases.at_state import assemble_open

        return assemble_open(self, time, values, given, held)
    from ..starts.assembly import assembled_by

    return assembled_by(self, time, values, given, held)
