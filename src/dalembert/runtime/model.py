"""`CompiledModel`: what `dalembert.compile_model` hands back."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, final

import numpy as np

from ..codegen import backend_named
from ..codegen.base import Engine
from ..errors import OptionError, nesting_named
from ..integrators.problem import IntegrationProblem
from ..once import derived_once
from ..options import CompileOptions
from ..pipeline import Compiled, Stages, compile_stages
from ..reduction.modes import Mode
from ..results.comparison import Comparison
from ..results.linearization import Linearization
from ..results.sensitivity import Sensitivity
from ..scene import Scene
from ..values import option, times_of, tolerances, whole
from . import inputs
from .comparing import compare
from .elapsed import begins_elsewhere, elapsed_times, noted_from
from .held import span_of
from .linear import linearized
from .segments import at_time, segmented, starting_constants
from .sensitivity import Variation, chosen_names, through_offsets, vary
from .swept import Swept

__all__ = ["CompiledModel", "compiled_mode"]


@final
class CompiledModel(Swept):
    """A scene compiled for one backend in one formulation.

    Attributes
    ----------
    stages : Stages
        Every object of the pipeline, from the scene to the rendered module.
    layout : Layout
        Names of everything that arrays hold.
    """

    def __init__(self, stages: Stages, engine: Engine, methods: Mapping[str, str]) -> None:
        super().__init__(stages, engine, methods)
        engine.accept_as_static(CompiledModel)
        self._others: dict[str, CompiledModel] = {}
        self._variations: dict[tuple[tuple[str, ...], ...], Variation] = {}

    @classmethod
    def of(cls, compiled: Compiled) -> CompiledModel:
        """Return the model of a scene that went through all stages."""
        stages = compiled.stages
        return cls(stages, segmented(compiled.engine, stages.program), compiled.methods)

    def _recompiled(self, without: tuple[int, ...], kept: tuple[str, ...] | None = None) -> CompiledModel:
        """See `Held._recompiled`."""
        stages = self.stages
        options = replace(stages.options, formulation=stages.program.formulation)
        return compiled_mode(stages.scene, options, stages.mode, without, stages.kept if kept is None else kept)

    def _in_elapsed_time(self, watched: Sequence[Any]) -> CompiledModel:
        """See `Held._in_elapsed_time`."""
        stages = self.stages
        return compiled_mode(stages.scene.in_elapsed_time(watched), stages.options, stages.mode, (), stages.kept)

    @nesting_named
    def compare_formulations(
        self,
        t_span: tuple[float, float],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        formulations: Sequence[str] | None = None,
        method: str | Mapping[str, str] = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
    ) -> Comparison:
        """Run one motion in every formulation and return a table of errors, violations, energy drift, steps and time.

        Parameters
        ----------
        t_span, initial, parameters, rtol, atol
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
        run, known = (t_span, initial, parameters), backend_named(self.backend).methods
        return compare(self._in_formulation, self.name, formulations, run, tolerances(rtol, atol), method, known)

    @nesting_named
    def linearize(
        self,
        t: float,
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        states: Sequence[str] | None = None,
    ) -> Linearization:
        """Linearise the motion about a state, in independent coordinates and speeds.

        Parameters
        ----------
        t : float
            Time [s].
        initial, parameters : mapping of symbols or names to numbers
            The state and the parameters, as for `simulate`: what the constraints fix may be left out.
        states : sequence of str, optional
            Names of the independent components to use, of ``layout.state``; by default the formulation's own, or those
            that the constraints fix least.

        Returns
        -------
        Linearization
            With named rows and columns, and `eigenvalues`.

        Raises
        ------
        UnknownNameError, ValueInputError, InitialStateError, OptionError
            For input that is wrong.
        """
        p = self.parameter_vector(parameters)
        c = inputs.constants(self._program, p)
        values = inputs.given_values(self.layout, initial)
        time = option("t", t)
        c = at_time(self._program, c, time)
        y = inputs.initial_state(self._start(values), time, values, c, self._program)
        return linearized(self._program, time, y, p, c, states)

    def _in_formulation(self, name: str) -> CompiledModel:
        """Return the scene's model in another formulation, on the same backend, compiled once."""
        if name == self.formulation:
            return self
        options = CompileOptions(backend=self.backend, formulation=name)
        return derived_once(self._others, name, lambda: compiled_mode(self.stages.scene, options, self.stages.mode))

    @nesting_named
    def sensitivity(
        self,
        t_span: tuple[float, float],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        wrt: Iterable[Any],
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
        t_span, initial, parameters, t_eval, method, rtol, atol, max_steps
            As for `simulate`.
        wrt : iterable of symbols or names
            Parameters, and values given in `initial`. What the constraints fix varies with them where it is left out.
        of : iterable of symbols or names, optional
            Coordinates, rates, components of the state and outputs; by default all coordinates and rates.

        Returns
        -------
        Sensitivity
            ``.jacobian("x", "m")`` (n_t,) and so on.

        Raises
        ------
        UnknownNameError, ValueInputError, InitialStateError, OptionError
            For input that is wrong.
        """
        t0, t1 = span_of(t_span)
        options: dict[str, Any] = {"of": of, "method": method, "rtol": rtol, "atol": atol, "max_steps": max_steps}
        other = self._counting(t0, t1)[0] if begins_elsewhere(t0, t1) else None
        if other is None:
            return self._sensitivity((t0, t1), initial, parameters, wrt=wrt, t_eval=t_eval, **options)
        assert isinstance(other, CompiledModel)
        times = None if t_eval is None else times_of("t_eval", t_eval)
        options["t_eval"] = elapsed_times(t0, t1, times)
        given = self._with_offsets(other, t0, parameters)
        wanted = wrt if isinstance(wrt, str) else list(wrt)
        names = {self.layout.aliases.get(str(w), str(w)) for w in ([wanted] if isinstance(wanted, str) else wanted)}
        every = other.stages.equations.symbols.offsets
        offsets = [offset for offset in every if any(symbol.name in names for symbol in offset.symbols)]
        more = (*([wanted] if isinstance(wanted, str) else wanted), *(offset.name for offset in offsets))
        try:
            found = other._sensitivity((0.0, t1 - t0), initial, given, wrt=more if offsets else wanted, **options)
        except OptionError as refusal:
            raise OptionError(noted_from(str(refusal), t0)) from None
        if offsets:
            p = dict(zip(self.layout.parameters, self.parameter_vector(parameters).tolist(), strict=True))
            found = through_offsets(found, offsets, t0, p)
        return replace(found, t=t0 + found.t if times is None else times[: len(found.t)])

    def _sensitivity(
        self,
        t_span: tuple[float, float],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        wrt: Iterable[Any],
        of: Iterable[Any] | None,
        t_eval: Any,
        method: str,
        rtol: float,
        atol: float,
        max_steps: int,
    ) -> Sensitivity:
        """Simulate with derivatives, as `sensitivity` does, in the time of this model."""
        t0, t1 = t_span
        rtol, atol = tolerances(rtol, atol)
        p = self.parameter_vector(parameters)
        values = inputs.given_values(self.layout, initial)
        options: dict[str, Any] = {"t_eval": t_eval, "method": method, "rtol": rtol, "atol": atol}
        options |= {"max_steps": max_steps}
        divisible = self._divisible(t0, initial, parameters)
        if divisible is not self and isinstance(divisible, CompiledModel):
            return divisible._sensitivity(t_span, initial, parameters, wrt=wrt, of=of, **options)
        start = self._start(values)
        names = chosen_names(self._program, start.given, of, wrt)
        c = starting_constants(self._program, inputs.constants(self._program, p), t0, t1)
        problem = IntegrationProblem(
            t0=t0,
            t1=t1,
            y0=inputs.initial_state(start, t0, values, c, self._program),
            constants=c,
            rtol=rtol,
            atol=atol,
            t_eval=None if t_eval is None else times_of("t_eval", t_eval),
            max_steps=whole("max_steps", max_steps),
        )
        able = self._independent(problem, method, time.perf_counter())
        if able is not self and isinstance(able, CompiledModel):
            return able._sensitivity(t_span, initial, parameters, wrt=names[1], of=names[0], **options)
        key = (start.given, *names)
        variation = derived_once(self._variations, key, lambda: vary(self.stages, start.given, *names))
        named: object = method
        if isinstance(named, str) and named == "auto":
            chosen = variation.engine.automatic(self.methods, rtol, atol)
        else:
            chosen = self._method(method, rtol, atol)
        given = np.array([values[name] for name in start.given])
        return replace(variation.run(problem, given, p, chosen), aliases=self.layout.aliases)

    def vector_field(self, t: Any, y: Any, args: Any) -> Any:
        """Return dy/dt (n_y,) of the state y (n_y,) at parameters args (n_p,), traced: made for ``diffrax.ODETerm``.

        The components are those of ``layout.state`` and ``layout.parameters``; `state` and `parameter_vector` make
        such arrays.

        Raises
        ------
        OptionError
            For a backend other than "jax".
        """
        return self._engine.vector_field(t, y, args)

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
            "reverse" for gradients (``jax.grad``, ``jax.vjp``), "forward" for ``jax.jvp`` and ``jax.jacfwd``.
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
        OptionError
            For a backend other than "jax", and for options that do not exist.
        UnknownNameError, InitialStateError
            For names that are not known or not enough.
        """
        start = None
        if given is not None:
            names = [self.layout.aliases.get(str(name), str(name)) for name in given]
            start = self._start(inputs.given_values(self.layout, dict.fromkeys(names, 0.0)))
        options = {"mode": mode, "rtol": rtol, "atol": atol, "max_step": max_step, "max_steps": max_steps}
        return self._engine.solve_fn(start, self._method(method, rtol, atol), options)

    def __reduce__(self) -> tuple[Any, ...]:
        return compiled_mode, (self.stages.scene, self.stages.options, self.stages.mode, (), self.stages.kept)


def compiled_mode(
    scene: Scene,
    options: CompileOptions,
    mode: Mode | None,
    without: tuple[int, ...] = (),
    kept: tuple[str, ...] = (),
) -> CompiledModel:
    """Return the model of a scene in one of the modes of its contacts; None for a scene that has only one."""
    compiled = compile_stages(scene, options, without, mode, kept)
    assert isinstance(compiled, Compiled)
    return CompiledModel.of(compiled)
