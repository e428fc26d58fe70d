"""Interface of all models, of scenes without and with contacts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

from ..arrays import FloatArray
from ..ir.program import Layout
from ..mechanics.equations import EquationsOfMotion
from ..once import once_property
from ..options import PrepareOptions, SensitivityOptions, SimulateOptions, StoreOptions, SweepOptions, TrimOptions
from ..scene.model import ControllerModel
from ..scene.symbol_table import InputSymbol
from . import inputs as run_input
from .interface import derivatives, evaluation, motions, states, sweeps
from .symbol_assumptions import ROUNDING
from .value_reader import ValueReader

if TYPE_CHECKING:
    from ..codegen.runs import Prepared
    from ..results.case_results import CaseResults
    from ..results.discrete_linearization import DiscreteLinearization
    from ..results.linearization import Linearization
    from ..results.motion import Motion
    from ..results.operating_point import OperatingPoint
    from ..results.sensitivity import Sensitivity
    from .input_values import GivenInputs
    from .model import CompiledModel

__all__ = ["Model"]

Given = Mapping[Any, Any]
RunT_co = TypeVar("RunT_co", bound="Motion", covariant=True)
SweepT_co = TypeVar("SweepT_co", bound="CaseResults", covariant=True)


class Model(ABC, Generic[RunT_co, SweepT_co]):
    """Compiled scene: its methods are functions over a model, in `dalembert.runtime.interface`.

    They check arguments, make frozen options of them, and call the methods below. The type
    variables are those of a trajectory and of the results of many cases.

    Attributes
    ----------
    layout : Layout
        Names of everything that arrays hold.
    """

    layout: Layout

    parameter_vector = states.parameter_vector
    initial_values = states.initial_values
    state = states.state
    mass_matrix = evaluation.mass_matrix
    forcing = evaluation.forcing
    constraint_jacobian = evaluation.constraint_jacobian
    accelerations = evaluation.accelerations
    simulate = motions.simulate
    sweep = sweeps.sweep
    prepare = motions.prepare
    assemble = states.assemble
    sensitivity = derivatives.sensitivity
    linearize = derivatives.linearize
    trim = derivatives.trim

    # -- what a kind of model implements ----------------------------------------------------

    @property
    @abstractmethod
    def _equations(self) -> EquationsOfMotion:
        """The equations of the scene."""

    @abstractmethod
    def _outputs(self, kernel: str, t: FloatArray, x: FloatArray, p: FloatArray) -> FloatArray | None:
        """Return outputs (k, n_out) at times (k,), variables x (k, 2 n_q + n_z) and parameters (n_p,) or (k, n_p).

        The variables are coordinates, rates and first-order states. None stands for zeros.
        """

    @abstractmethod
    def _depends_on_states(self, kernel: str) -> bool:
        """Whether the outputs of a kernel depend on first-order states."""

    @abstractmethod
    def _state(self, t: float, initial: Given, parameters: Given) -> FloatArray:
        """Return the state at given values; the parameters have those of the inputs, here and below."""

    @abstractmethod
    def _simulate_in_own_time(
        self, t_span: tuple[float, float], initial: Given, parameters: Given, options: SimulateOptions
    ) -> RunT_co:
        """Return one trajectory in the time of the model, whatever the span."""

    @abstractmethod
    def _with_parameters(self, symbols: tuple[Any, ...]) -> Self:
        """Return the model of the scene with further parameters, which only events and reductions contain."""

    @abstractmethod
    def _in_elapsed_time(self, watched: tuple[Any, ...]) -> Self:
        """Return the model of the scene in the time since a start, with expressions of time that events contain."""

    @abstractmethod
    def _check_watched(self, events: Any, reduce: Any) -> None:
        """Refuse events and reductions that cannot be watched, as a run does."""

    @abstractmethod
    def _sweep_in_own_time(
        self, t_span: tuple[Any, Any], initial: Given, parameters: Given, options: SweepOptions
    ) -> SweepT_co:
        """Return the results of many cases in the time of the model, whatever the spans."""

    @abstractmethod
    def _stored_sweep(
        self, given: tuple[Any, Given, Given, Given | None], options: SweepOptions, to: StoreOptions
    ) -> Any:
        """Return the results of many cases (span, initial values, parameters, inputs) from a store."""

    @abstractmethod
    def _prepare_in_own_time(self, t_span: tuple[float, float], options: PrepareOptions) -> tuple[str, Prepared]:
        """Return a method, and a run from a state and parameters to the final state, in the time of the model."""

    @abstractmethod
    def _assemble(
        self, t: float, guess: dict[str, float], parameters: Given, fixed: Collection[str]
    ) -> dict[str, float]:
        """Return consistent initial values near a guess."""

    @abstractmethod
    def _sensitivity(
        self, t_span: tuple[float, float], initial: Given, parameters: Given, options: SensitivityOptions
    ) -> Sensitivity:
        """Return one trajectory with derivatives."""

    @abstractmethod
    def _linearize(
        self, t: float, initial: Given, parameters: Given, states: Sequence[str] | None, outputs: Any
    ) -> Linearization:
        """Return the linearisation about a state."""

    @abstractmethod
    def _linearize_period(
        self,
        t: float,
        initial: Given,
        parameters: Given,
        inputs: GivenInputs | None,
        states: Sequence[str] | None,
        outputs: Any,
    ) -> DiscreteLinearization:
        """Return the linearised map over the period of the controllers."""

    @abstractmethod
    def _trim(self, guess: Given, parameters: Given, options: TrimOptions) -> OperatingPoint:
        """Return an equilibrium or a steady motion."""

    # -- what functions over models read ---------------------------------------------------

    @property
    def _traced_functions(self) -> Any:
        """The kernels as functions that JAX traces, None for models that have none."""
        return None

    @property
    @abstractmethod
    def _starting_model(self) -> CompiledModel:
        """The model that reads initial values and parameters of cases."""

    @property
    def _prepared_layout(self) -> Layout:
        """The layout of states and parameters of prepared runs."""
        return self.layout

    @property
    def _inputs(self) -> tuple[InputSymbol, ...]:
        """The inputs of the scene."""
        return self._equations.symbols.inputs

    @property
    def _controllers(self) -> tuple[ControllerModel, ...]:
        """The controllers of the scene."""
        return self._equations.controllers

    @once_property
    def _read_parameters(self) -> ValueReader:
        layout = self.layout
        return ValueReader(lambda given: run_input.parameter_values(layout, given), layout.aliases, layout.assumptions)

    @once_property
    def _read_initial(self) -> ValueReader:
        layout = self.layout
        return ValueReader(
            lambda given: run_input.given_values(layout, given), layout.aliases, layout.assumptions, ROUNDING
        )
