"""`CompiledModel`: the result of `dalembert.compile_model`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING, Any, cast, final

import numpy as np

from ..arrays import FloatArray
from ..codegen import backend_named
from ..codegen.base import Capability, Engine
from ..errors import OptionError, list_names, nesting_named, unknown_name
from ..hybrid.modes import Mode
from ..ir.interpret import interpret_rows
from ..ir.program import Layout, representative
from ..once import once_property
from ..options import (
    CompileOptions,
    PrepareOptions,
    SensitivityOptions,
    StoreOptions,
    SweepOptions,
    TrimOptions,
    simulate_options,
)
from ..pipeline import Compiled, Stages, compile_equations, derive_scene
from ..reduction.sampling_kernels import sampling_kernels
from ..results.comparison import Comparison
from ..results.linearization import Linearization
from ..results.operating_point import OperatingPoint
from ..results.sampler import CaseSet
from ..results.sensitivity import Sensitivity
from ..results.sweep import Sweep
from ..results.trajectory import Trajectory
from ..scene import Scene
from ..scene.model import ControllerModel, InputSymbol
from ..values import option, tolerances
from . import inputs as run_input
from .assembly import assembled
from .capabilities import require
from .compare_formulations import compare_formulations
from .derived import Derived
from .evaluation import Evaluated, rows_of
from .explain import explain
from .impulses import landing_of
from .input_values import read_inputs, with_inputs
from .linearize import linearize
from .monitors import conserved
from .prepare import prepare
from .prepared import PreparedRun
from .sampling import WITHOUT, Sampling, refuse_functions, refuse_sampling
from .segments import at_time, segmented
from .sensitivity import sensitivity
from .simulate import simulate
from .sweep import sweep
from .trim import trim
from .variants import Variants

if TYPE_CHECKING:
    from ..codegen.base import FunctionEngine, TracedEngine

__all__ = ["CompiledModel"]

_MOST_CHOSEN = 64
"""Tolerances for which the method that "auto" takes is remembered."""


@final
@dataclass(frozen=True, eq=False, repr=False)
class CompiledModel(Evaluated):
    """A scene compiled for one backend in one formulation.

    It holds what was compiled and does not change; `simulate`, `sweep`, `prepare`, `sensitivity`, `linearize` and
    `explain` are functions over it, in modules of these names. Models of equal programs are equal: compiled code that
    JAX keeps for one serves the other.

    Attributes
    ----------
    stages : Stages
        Every object of the pipeline, from the scene to the rendered module.
    engine : Engine
        The loaded module: compiled kernels, and integrators that call them.
    method_descriptions : mapping of str to str
        Integration methods by name, each with one line of description.
    dropped : tuple of int
        Constraints that are not enforced, because they follow from the others around the start of a run.
    layout : Layout
        Names of everything that arrays hold.
    derived : Derived
        Kernels and facts that are derived on demand, and kept.
    variants : Variants
        Other models of the scene that runs need, compiled on demand, and kept.
    """

    stages: Stages
    engine: Engine
    method_descriptions: Mapping[str, str]
    dropped: tuple[int, ...]
    derived: Derived
    variants: Variants
    layout: Layout = field(init=False)
    _chosen: dict[tuple[float, float, bool], str] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "layout", self.stages.program.layout)
        self.engine.accept_as_static(CompiledModel)

    @classmethod
    def of(cls, compiled: Compiled, dropped: tuple[int, ...] = ()) -> CompiledModel:
        """Return the model of a scene that went through all stages."""
        stages = compiled.stages
        derived, variants = Derived(stages, compiled.engine), Variants(stages, dropped, cls.of)
        landing = landing_of(stages.equations, stages.program, derived.start)
        kernels = sampling_kernels(stages.reduced)
        sampling = None if kernels is None else Sampling(stages.program, kernels)
        engine = segmented(compiled.engine, stages.program, landing, sampling)
        return cls(stages, engine, compiled.methods, dropped, derived, variants)

    # -- what was compiled -----------------------------------------------------------------

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self.stages.program.name

    @property
    def _inputs(self) -> tuple[InputSymbol, ...]:
        """The inputs of the scene."""
        return self.stages.equations.symbols.inputs

    @property
    def _controllers(self) -> tuple[ControllerModel, ...]:
        """The controllers of the scene."""
        return self.stages.equations.controllers

    @property
    def backend(self) -> str:
        """Name of the backend."""
        return self.stages.rendered.backend

    @property
    def formulation(self) -> str:
        """Name of the formulation."""
        return self.stages.program.formulation

    @property
    def methods(self) -> tuple[str, ...]:
        """Integration methods of the backend; "auto" takes the first."""
        return tuple(self.method_descriptions)

    @property
    def note(self) -> str:
        """Which constraints are not enforced and why; nothing where all are."""
        labels = [self.layout.constraints[i] for i in self.dropped]
        if not labels:
            return ""
        return f"not enforced, because it follows from the others around the start: {'; '.join(labels)}"

    @property
    def source(self) -> str:
        """The generated code that runs by default, by the method "auto" at the default tolerances."""
        return self.stages.rendered.source

    def source_of(self, method: str = "auto", rtol: float = 1e-8, atol: float = 1e-10) -> str:
        """Return the generated code that `simulate` runs by a method at some tolerances.

        Raises
        ------
        OptionError
            For a method that the backend does not have, or tolerances that are not positive.
        """
        rtol, atol = tolerances(rtol, atol)
        return self.engine.source_of(self.choose_method(method, rtol, atol), rtol, atol) or self.source

    def choose_method(self, method: Any, rtol: float, atol: float, *, many: bool = False) -> str:
        """Return the method that a run takes, checked; `many` says whether it is to run many cases at once.

        Raises
        ------
        OptionError
            For a method that the model does not have, with those that it has.
        """
        if isinstance(method, str) and method == "auto":
            key = rtol, atol, many
            found = self._chosen.get(key)
            if found is None:
                if len(self._chosen) >= _MOST_CHOSEN:
                    self._chosen.clear()
                found = self._chosen[key] = self.engine.automatic(self.methods, rtol, atol, many=many)
            return found
        if isinstance(method, str) and method in self.method_descriptions:
            return method
        why = backend_named(self.backend).refusal(self.stages.program, str(method))
        if why:
            raise OptionError(f"{why}. Take one of: {list_names(['auto', *self.methods])}")
        raise OptionError(
            unknown_name("method", str(method), ["auto", *self.methods]) + f" (of the backend {self.backend!r})"
        )

    @property
    def kernels(self) -> Any:
        """The generated kernels as functions of numba, by name, for people's own compiled code (backend "numba").

        ``prepare(p, c)`` computes constants c (``layout.constants``,) from parameters p (n_p,), ``rhs(t, y, c, out)``
        the rate of the state, and so on: see `source`. numba compiles each when it is first called.

        Raises
        ------
        CapabilityError
            For another backend, and for scenes whose functions of time a run takes piece by piece.
        """
        require(self.backend, self.stages.program, Capability.KERNEL_FUNCTIONS)
        return cast("FunctionEngine", self.engine).functions

    def explain(self, *, passes: bool = False, formulations: bool = False) -> str:
        """Return, in a few lines, what was chosen and why, what was left out, and operation counts.

        Parameters
        ----------
        passes : bool
            Whether to list the passes that made the program, each with its time in all kernels and the operations that
            it removed from each. Passes on steps of integrators, which are made when a run needs them, are not among
            them.
        formulations : bool
            Whether to count the operations of a right-hand side in every formulation, which derives them. Otherwise
            nothing is derived or compiled.
        """
        return explain(self, passes=passes, formulations=formulations)

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, CompiledModel) and self._identity == other._identity)

    def __hash__(self) -> int:
        return hash(self._identity[1:])

    @once_property
    def _identity(self) -> tuple[Any, ...]:
        """The parts that decide whether models are equal: then compiled code of one serves the other."""
        program = representative(self.stages.program)
        return program, hash(program), self.backend, self.dropped, self.stages.kept

    def __repr__(self) -> str:
        return f"<CompiledModel {self.name!r}: {self.formulation}, {self.backend}>"

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.explain())}</pre>"

    def __reduce__(self) -> tuple[Any, ...]:
        return _compiled_again, (self.stages.scene, self.stages.options, self.stages.mode, self.stages.kept)

    # -- motions ---------------------------------------------------------------------------

    @nesting_named
    def simulate(
        self,
        t_span: tuple[float, float],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        inputs: Mapping[Any, Any] | None = None,
        t_eval: Any = None,
        method: str = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
        first_step: float | None = None,
        max_step: float = np.inf,
        max_steps: int = 1_000_000,
        dense: bool = True,
        error_estimate: bool = False,
        events: Any = (),
        project_invariants: Any = False,
        progress: bool = False,
    ) -> Trajectory:
        """Simulate one trajectory.

        Parameters
        ----------
        t_span : (float, float)
            Start and end [s]; the end may lie before the start. A run is computed in the time since its start, so that
            what is rounded of late times is no more than each ``t - t0`` as given, and the times of events, which are
            rounded to doubles: 2e-7 s where seconds are counted from 1970. A scene that contains time itself is
            compiled once more for runs whose times are more than 16 times as large as their spans.
        initial : mapping of symbols or names to numbers
            Coordinates and rates at the start. A rate is ``x.diff()`` or ``"x_dot"``. What the constraints fix may
            be left out.
        parameters : mapping of symbols or names to numbers
            Every parameter of the scene, and of the events.
        inputs : mapping of symbols or names to numbers or samples, optional
            Every input of the scene: a number is constant in time, a record is made by `dalembert.samples`.
        t_eval : array_like (n_t,), optional
            Times to record; without it, the accepted steps.
        method : str
            A name in `methods`, or "auto".
        rtol, atol : float
            Tolerances of the local error of every component of the state.
        first_step, max_step : float, optional
            First and largest step [s].
        max_steps : int
            Attempted steps after which the run ends with a status.
        dense : bool
            Whether the trajectory can be evaluated between the recorded times.
        error_estimate : bool
            Whether to run a twin at a hundredth of the tolerances beside it, from which
            ``trajectory.error_estimate["x"]`` estimates the global error of anything at the recorded times.
        events : sequence of Event, SymPy expressions or names
            What to watch for: sign changes, all of them, located to rounding; see `Event`. They are in
            ``trajectory.events``, by name. A sign change at the very start is none.
        project_invariants : bool, str or sequence of str
            First integrals to keep at their initial values by a correction after every step, together with the
            constraints: names as in ``trajectory.invariants``, or True for all that are conserved.
        progress : bool
            Whether to show a bar with the time that the run has reached (needs tqdm). It advances between blocks of
            steps, which stay as they are; on the backend "jax" at the end only.

        Returns
        -------
        Trajectory
            Numerical failure is its `status`, never an exception.

        Raises
        ------
        UnknownNameError, ValueInputError, InitialStateError, OptionError, ExpressionError
            For input that is wrong, each naming what, what is allowed and what to do.
        """
        options = simulate_options(
            method,
            rtol,
            atol,
            max_step,
            max_steps,
            first_step,
            dense,
            error_estimate,
            project_invariants,
            t_eval=t_eval,
            events=events,
            inputs=read_inputs(self.layout, self._inputs, inputs),
            progress=progress,
        )
        return simulate(self, t_span, initial, parameters, options)

    @nesting_named
    def sweep(
        self,
        t_span: tuple[Any, Any],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        inputs: Mapping[Any, Any] | None = None,
        grid: CaseSet | None = None,
        t_eval: Any = None,
        method: str = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
        max_step: float = np.inf,
        max_steps: int = 1_000_000,
        threads: int | None = None,
        progress: bool = False,
        error_estimate: bool = False,
        events: Any = (),
        reduce: Any = None,
        project_invariants: Any = False,
        to: Any = None,
        chunk: int | None = None,
        client: Any = None,
        resume: bool = True,
    ) -> Sweep | Any:
        """Simulate many cases, each with its own steps and status; one that fails never touches its neighbours.

        Parameters
        ----------
        t_span : (float or array_like (n_case,), float or array_like (n_case,))
            Start and end [s], for all cases or one each. Late times lose no digits, as for `simulate`.
        initial, parameters : mapping of symbols or names to numbers or array_like (n_case,)
            Scalars serve all cases. A value that is not finite, or of an array one that its symbol excludes, is the
            status of its case, not an error.
        inputs : mapping of symbols or names to numbers, array_like (n_case,) or samples, optional
            Every input of the scene, as for `simulate`; records may have one row a case.
        grid : Grid or CaseSampler, optional
            From ``dalembert.grid(b=..., x_dot=...)``: every combination of some parameters and initial values; or
            random cases from `random_cases` or `sobol_cases`.
        t_eval : array_like (n_t,), optional
            Times to record for all cases; without it, final states only.
        method, rtol, atol, max_step, max_steps
            As for `simulate`.
        threads : int, optional
            Threads to use; by default as many as there are processors.
        progress : bool
            Whether to show a bar with cases per second (needs tqdm).
        error_estimate : bool
            Whether to run every case once more at a hundredth of the tolerances, from which
            ``sweep.error_estimate["x"]`` estimates the global errors.
        events : sequence of Event, SymPy expressions or names
            What to watch for in every case, as for `simulate`. ``sweep.events["name"]`` has how often each occurred,
            and when first and last.
        reduce : mapping of str to reductions, or sequence of expressions or names
            What to keep of every motion: `dalembert.final`, `minimum`, `maximum`, `mean` and `first_crossing` of
            expressions as in `Event`; a sequence stands for final values. ``sweep.reduced["name"]`` has them, NaN
            for cases that failed.
        project_invariants : bool, str or sequence of str
            First integrals to keep, as for `simulate`: those that are conserved in the first case that can start.
        to : str, Path or zarr store, optional
            A store in which the results are kept, chunk by chunk (needs the extra ``dask``). The same call goes on
            where an earlier one ended.
        chunk : int, optional
            Cases of a chunk; by default as many as take some seconds or 128 MiB.
        client : distributed.Client, optional
            A cluster that computes the chunks; by default this process does.
        resume : bool
            Whether to go on with a store of the same sweep; otherwise an existing store is an error.

        Returns
        -------
        Sweep
            After Ctrl-C, with the cases that were finished; the others have the status INTERRUPTED. Where `to` is
            given, an ``xarray.Dataset`` in place of it, which reads the store when it is asked.

        Raises
        ------
        UnknownNameError, ValueInputError, InitialStateError, OptionError
            For input that is wrong for all cases, and for a store that holds something else.
        MissingExtraError, StoredSweepError
            Where `to` is given: without the packages that it needs, and where chunks could not be computed.
        """
        refuse_functions(self._controllers, "a sweep")
        options = SweepOptions(
            method=method,
            rtol=rtol,
            atol=atol,
            max_step=max_step,
            max_steps=max_steps,
            grid=grid,
            t_eval=t_eval,
            threads=threads,
            progress=progress,
            error_estimate=error_estimate,
            events=events,
            reduce=reduce,
            project_invariants=project_invariants,
            inputs=read_inputs(self.layout, self._inputs, inputs, many=True) if to is None else None,
        )
        if to is None:
            return sweep(self, t_span, initial, parameters, options)
        from .stored.sweep import stored_sweep

        where = StoreOptions(to=to, chunk=chunk, client=client, resume=resume)
        return stored_sweep(self, (t_span, initial, parameters, inputs), options, where)

    @nesting_named
    def prepare(
        self,
        t_span: tuple[float, float],
        *,
        inputs: Mapping[Any, Any] | None = None,
        method: str = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
        max_step: float = np.inf,
        max_steps: int = 1_000_000,
        project_invariants: Any = False,
    ) -> PreparedRun:
        """Return ``run(state, p)``, which gives the final state of many short runs with next to no overhead.

        Parameters
        ----------
        t_span, method, rtol, atol, max_step, max_steps
            As for `simulate`.
        inputs : mapping of symbols or names to numbers or samples, optional
            Every input of the scene, the same for all runs. Without it each run is given its own,
            ``run(state, p, inputs)`` with an array of numbers in the order of ``layout.inputs``, held over the run: so
            the loop around a controller of your own is closed.
        project_invariants : bool, str or sequence of str
            First integrals to keep, as for `simulate`: those that are conserved from the first state that the function
            is called with, which also compiles it. Their initial values are computed before each run, which takes some
            hundred microseconds.

        Raises
        ------
        OptionError, FormulationError, UnknownNameError
            For options that do not exist, and integrals that are not known or that the formulation cannot keep.
        """
        refuse_functions(self._controllers, "a prepared run")
        options = PrepareOptions(
            method=method,
            rtol=rtol,
            atol=atol,
            max_step=max_step,
            max_steps=max_steps,
            project_invariants=project_invariants,
            inputs=None if inputs is None else read_inputs(self.layout, self._inputs, inputs),
        )
        return prepare(self, t_span, options)

    @nesting_named
    def sensitivity(
        self,
        t_span: tuple[float, float],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        wrt: Iterable[Any],
        inputs: Mapping[Any, Any] | None = None,
        of: Iterable[Any] | None = None,
        t_eval: Any = None,
        method: str = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
        max_steps: int = 1_000_000,
    ) -> Sensitivity:
        """Simulate one trajectory with the derivatives of what happens along it.

        Generated variational equations are integrated beside the equations of motion, under the same control of
        error. The consistent start and the projection onto constraints are differentiated along.

        Parameters
        ----------
        t_span, initial, parameters, inputs, t_eval, method, rtol, atol, max_steps
            As for `simulate`.
        wrt : iterable of symbols or names
            Parameters, and values given in `initial`. What the constraints fix varies with them where it is left out.
        of : iterable of symbols or names, optional
            Coordinates, rates, states and their rates, components of the state and outputs; by default all
            coordinates, rates and states.

        Returns
        -------
        Sensitivity
            ``.jacobian("x", "m")`` (n_t,) and so on.

        Raises
        ------
        UnknownNameError, ValueInputError, InitialStateError, OptionError
            For input that is wrong.
        """
        refuse_functions(self._controllers, "sensitivity")
        options = SensitivityOptions(
            method=method,
            rtol=rtol,
            atol=atol,
            max_steps=max_steps,
            wrt=wrt,
            of=of,
            t_eval=t_eval,
            inputs=read_inputs(self.layout, self._inputs, inputs),
        )
        return sensitivity(self, t_span, initial, parameters, options)

    @nesting_named
    def linearize(
        self,
        t: float,
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        inputs: Mapping[Any, Any] | None = None,
        states: Sequence[str] | None = None,
        outputs: Iterable[Any] | None = None,
    ) -> Linearization:
        """Linearise the motion about a state, in independent coordinates and speeds.

        The result holds on the constraints, nonholonomic ones too: its states are the directions that they leave free.

        Parameters
        ----------
        t : float
            Time [s].
        initial, parameters : mapping of symbols or names to numbers
            The state and the parameters, as for `simulate`: what the constraints fix may be left out.
        inputs : mapping of symbols or names to numbers or samples, optional
            Every input of the scene, the columns of `B` and `D`.
        states : sequence of str, optional
            Names of the independent components to use, of coordinates and rates, or of ``layout.state``; by default
            the coordinates and rates that the constraints fix least, the same in every formulation (with unit
            quaternions, `minimal` takes angular velocities).
        outputs : iterable of symbols or names, optional
            Coordinates, rates, components of the state and compiled outputs, the rows of `C` and `D`; by default the
            independent components.

        Returns
        -------
        Linearization
            A, B, C and D with named rows and columns, `eigenvalues`, and `to_control()` for python-control.

        Raises
        ------
        UnknownNameError, ValueInputError, InitialStateError, OptionError
            For input that is wrong.
        """
        refuse_sampling(self._controllers, "linearize", WITHOUT)
        given = with_inputs(self.layout, self._inputs, inputs, parameters, option("t", t))
        return linearize(self, t, initial, given, states, outputs)

    @nesting_named
    def trim(
        self,
        guess: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        inputs: Mapping[Any, Any] | None = None,
        free: Iterable[Any] | None = None,
        steady: Iterable[Any] | None = None,
        t: float = 0.0,
        tolerance: float = 1e-12,
        max_iterations: int = 100,
    ) -> OperatingPoint:
        """Find an equilibrium or a steady motion near a guess, by Newton's method with exact derivatives.

        Values that are `free` change until the constraints hold and what is `steady` does not change in time. All
        other values are held. Where the conditions do not determine the free values, each Newton step takes the least
        change, and the result names what is undetermined.

        Parameters
        ----------
        guess : mapping of symbols or names to numbers
            Every coordinate and first-order state, and the rates: 0 for an equilibrium. Rates that the constraints fix
            may be left out.
        parameters : mapping of symbols or names to numbers
            Every parameter of the scene.
        inputs : mapping of symbols or names to numbers, optional
            Every input of the scene; it stays constant.
        free : iterable of symbols or names, optional
            Coordinates, rates, states, parameters and inputs that may change; their values above are where Newton's
            method starts. By default all coordinates and states.
        steady : iterable of symbols or names, optional
            Coordinates, rates and states that must not change in time: ``x.diff()`` stands for a vanishing
            acceleration, ``x`` for a vanishing rate. By default all rates and states, and in scenes with velocity
            constraints those rates that `guess` gives: in a steady turn the others go on changing.
        t : float
            Time [s], where the scene depends on it. The conditions hold at this time.
        tolerance : float
            What may be left of a condition, as a share of the size of its terms.
        max_iterations : int
            Most Newton steps.

        Returns
        -------
        OperatingPoint
            Values by name, what is left of each condition, `converged` and a message: where conditions could not be
            met, it says which.

        Raises
        ------
        UnknownNameError, ValueInputError, InitialStateError
            For input that is wrong.
        OptionError
            For more conditions than free values, where not all of them can hold.

        Examples
        --------
        ::

            point = model.trim({x: 0, theta: 0.3, x.diff(): 0, theta.diff(): 0}, p, free=[theta, "F"])
            model.linearize(0.0, point.initial, point.parameters).eigenvalues
        """
        options = TrimOptions(free=free, steady=steady, t=t, tolerance=tolerance, max_iterations=max_iterations)
        given = with_inputs(self.layout, self._inputs, inputs, parameters, options.t)
        return trim(self, guess, given, options)

    @nesting_named
    def compare_formulations(
        self,
        t_span: tuple[float, float],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        inputs: Mapping[Any, Any] | None = None,
        formulations: Sequence[str] | None = None,
        method: str | Mapping[str, str] = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
    ) -> Comparison:
        """Run one motion in every formulation and return a table of errors, violations, energy drift, steps and time.

        Parameters
        ----------
        t_span, initial, parameters, inputs, rtol, atol
            As for `simulate`.
        formulations : sequence of str, optional
            Which to compare; all by default.
        method : str or mapping of str to str
            The method for all formulations, or one each; a formulation that does not have it takes "auto".

        Returns
        -------
        Comparison
            One row a formulation, also for those that cannot serve the scene; ``print`` shows it.

        Raises
        ------
        OptionError
            For unknown formulations and methods, and as `simulate`.
        """
        run = t_span, initial, parameters, inputs
        return compare_formulations(self, run, tolerances(rtol, atol), formulations, method)

    # -- states ----------------------------------------------------------------------------

    @nesting_named
    def state(
        self,
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        t: float = 0.0,
        inputs: Mapping[Any, Any] | None = None,
    ) -> FloatArray:
        """Return the state y (n_y,) of the formulation at consistent initial values, as `simulate` starts from it."""
        program, time = self.stages.program, option("t", t)
        given = with_inputs(self.layout, self._inputs, inputs, parameters, time)
        c = run_input.constants(program, self.parameter_vector(given))
        values = self.initial_values(initial)
        return run_input.initial_state(self.derived.start(values), time, values, at_time(program, c, time), program)

    def expand(
        self, t: float, y: FloatArray, parameters: Mapping[Any, Any], *, inputs: Mapping[Any, Any] | None = None
    ) -> FloatArray:
        """Return coordinates, rates and states (2 n_q + n_z,) of a state y (n_y,) of the formulation at time t."""
        program, time = self.stages.program, option("t", t)
        given = with_inputs(self.layout, self._inputs, inputs, parameters, time)
        c = run_input.constants(program, self.parameter_vector(given))
        state = rows_of("y", y, len(self.layout.state))
        c = at_time(program, c, time)
        return interpret_rows(program.kernel("expand"), np.array([time]), state[np.newaxis], c)[0]

    @nesting_named
    def assemble(
        self,
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
            What keeps exactly the value of the guess, such as the angle of a crank.

        Returns
        -------
        dict of str to float
            Coordinates, rates where the guess has any, and the states as they are given. Nearest is meant by the sum
            of the squares of the changes.

        Raises
        ------
        InitialStateError
            When the loops cannot close, with what is left of each constraint at the best position found.
        UnknownNameError, ValueInputError
            For input that is wrong.
        """
        program, time = self.stages.program, option("t", t)
        given = with_inputs(self.layout, self._inputs, inputs, parameters, time)
        c = run_input.constants(program, self.parameter_vector(given))
        values = run_input.given_values(self.layout, guess, plain=True)
        held = run_input.resolve_names("fixed name", fixed, values, self.layout.aliases)
        return assembled(program, at_time(program, c, time), time, values, held)

    def monitors(self, c: FloatArray, t: FloatArray, x: FloatArray) -> dict[str, FloatArray]:
        """Return the first integrals along a motion, as arrays (n_t,) by name.

        Parameters
        ----------
        c : ndarray (n_c,) or (n_t, n_c)
            Constants.
        t, x : ndarray (n_t,), (n_t, 2 n_q + n_z)
            Times [s]; coordinates, rates and first-order states.
        """
        return conserved(self.stages.program, self.derived.invariants, c, t, x)

    def _outputs(self, kernel: str, t: FloatArray, x: FloatArray, p: FloatArray) -> FloatArray | None:
        program = self.stages.program
        if kernel not in program:
            return None
        if p.ndim == 1:
            return self.engine.evaluate(kernel, t, x, run_input.constants(program, p))
        if program.conditions is not None:
            program.conditions.decide_at(p, t)
        return self.engine.rows(program.kernel(kernel), t, x, run_input.prepare_rows(program, p))

    def _depends_on_states(self, kernel: str) -> bool:
        program, first = self.stages.program, 2 * len(self.layout.coordinates)
        loads = program.kernel(kernel).loads if kernel in program else ()
        return any(load.array == "y" and load.index is not None and load.index >= first for load in loads)

    # -- programs in JAX -------------------------------------------------------------------

    @property
    def vector_field(self) -> Callable[[Any, Any, Any], Any]:
        """``vector_field(t, y, args)``: dy/dt (n_y,) of the state y (n_y,) at parameters args (n_p,), for JAX programs.

        It is traced, and made for ``diffrax.ODETerm``. The components are those of ``layout.state`` and
        ``layout.parameters``; `state` and `parameter_vector` make such arrays. Fields of equal models are equal.

        Raises
        ------
        CapabilityError
            For a backend other than "jax".
        OptionError
            When called with a state or parameters of another length.
        """
        require(self.backend, self.stages.program, Capability.VECTOR_FIELD)
        return cast("TracedEngine", self.engine).vector_field

    @property
    def functions(self) -> Any:
        """Pure functions of (t, y, p) that JAX traces, vectorises and differentiates, for the backend "jax".

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

    def solve_fn(
        self,
        given: Iterable[str] | None = None,
        *,
        method: str = "auto",
        mode: str = "reverse",
        rtol: float = 1e-8,
        atol: float = 1e-10,
        max_step: float = np.inf,
        max_steps: int = 4096,
    ) -> Any:
        """Return a pure function ``solve(t, initial, p)`` that JAX can trace, vectorise and differentiate.

        Parameters
        ----------
        given : iterable of str, optional
            Names of the coordinates and rates that `initial` holds; the others follow from the constraints, as in
            `simulate`. Without it, `initial` is the state y (n_y,).
        method, rtol, atol
            As for `simulate`.
        mode : str
            For "kvaerno5", "reverse" for gradients (``jax.grad``, ``jax.vjp``), "forward" for ``jax.jvp`` and
            ``jax.jacfwd``; the other methods serve both, nested too.
        max_step : float
            Largest step size [s]. Steps are chosen for the motion, and derivatives are those of these steps: where the
            motion is simpler than its neighbours (a sleigh that slides straight on), bound the step to resolve them.
        max_steps : int
            Attempted steps after which the run ends with a status.

        Returns
        -------
        Solve
            Its docstring describes arguments and result.

        Raises
        ------
        CapabilityError
            For a backend other than "jax".
        OptionError
            For options that do not exist.
        UnknownNameError, InitialStateError
            For names that are not known or not enough.
        """
        require(self.backend, self.stages.program, Capability.SOLVE_FUNCTION)
        refuse_sampling(self._controllers, "solve_fn", "use simulate or sweep, or write solve_fn over one period")
        start = None
        if given is not None:
            names = [self.layout.aliases.get(str(name), str(name)) for name in given]
            start = self.derived.start(run_input.given_values(self.layout, dict.fromkeys(names, 0.0)))
        options = {"mode": mode, "rtol": rtol, "atol": atol, "max_step": max_step, "max_steps": max_steps}
        method = self.choose_method(method, rtol, atol)
        return cast("TracedEngine", self.engine).solve_fn(start, method, options)


def _compiled_again(scene: Scene, options: CompileOptions, mode: Mode | None, kept: tuple[str, ...]) -> CompiledModel:
    """Return the model of a scene that has left the process, in one of the modes of its contacts."""
    derivation = derive_scene(scene, options)
    return CompiledModel.of(compile_equations(derivation, options, mode, (), kept, derivation.seconds))
