"""What is timed: a solver of one case, ready to be run at a tolerance."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from cases import END, Problem

import dalembert as da
from dalembert.errors import ConstraintError, FormulationError, OptionError, PrecisionWarning

warnings.simplefilter("ignore", PrecisionWarning)  # the tables go down to the floors, on purpose

__all__ = ["BACKEND_ORDER", "Contender", "Prepared", "absolute", "available_backends", "own"]

BACKEND_ORDER = ("llvm", "numba", "jax", "numpy")
"""The order of tables; backends of the registry that are not named here follow."""


@dataclass(frozen=True)
class Prepared:
    """A contender at one tolerance.

    Attributes
    ----------
    run : callable
        The integration alone, from state at the start to state at the end, as a peer offers it.
    call : callable or None
        The same as a user calls it: names looked up, initial state checked, trajectory built.
    error : float
        Largest error at the end, against the exact solution.
    steps, evaluations : int or None
        What the run took, where the solver says.
    """

    run: Callable[[], Any]
    call: Callable[[], Any] | None
    error: float
    steps: int | None = None
    evaluations: int | None = None


@dataclass(frozen=True)
class Contender:
    """A solver of one case.

    Attributes
    ----------
    solver, formulation, method : str
    prepare : callable
        Takes rtol and runs the solver once, so that everything is compiled.
    setting : str
        Options that are not the solver's own default, in a word or two.
    """

    solver: str
    formulation: str
    method: str
    prepare: Callable[[float], Prepared]
    setting: str = ""

    @property
    def label(self) -> str:
        """How figures and tables call it."""
        name = " ".join(part for part in (self.solver, self.formulation, self.method) if part)
        return f"{name}, {self.setting}" if self.setting else name


def absolute(rtol: float) -> float:
    """Return the absolute tolerance that goes with a relative one, for every solver that takes both."""
    return rtol / 100


def available_backends() -> tuple[list[str], list[str]]:
    """Return the backends of the registry that can be had, in `BACKEND_ORDER`, and a line for each that cannot."""
    from dalembert.codegen import BACKENDS, backend_named

    ordered = [name for name in BACKEND_ORDER if name in BACKENDS]
    found, missing = [], []
    for name in dict.fromkeys([*ordered, *BACKENDS]):
        try:
            backend_named(name)
            found.append(name)
        except ImportError as reason:
            missing.append(f"the backend {name!r} cannot be had here and is left out: {reason}")
    return found, missing


def own(problem: Problem, backend: str, formulations: Sequence[str], methods: int | None = None) -> Iterator[Contender]:
    """Yield dalembert's contenders: formulations that can serve times methods (the first few, or all)."""
    for formulation in formulations:
        try:
            model = da.compile_model(problem.build(), backend=backend, formulation=formulation)
        except (FormulationError, ConstraintError):
            continue
        for method in model.methods[:methods]:
            try:
                model.simulate((0, 0), problem.initial, problem.parameters, method=method)
            except OptionError:  # a method that cannot be projected
                continue
            yield Contender(f"dalembert {backend}", formulation, method, _preparation(problem, model, method))


def _preparation(problem: Problem, model: Any, method: str) -> Callable[[float], Prepared]:
    initial, parameters = problem.initial, problem.parameters
    state, p = model.state(initial, parameters), model.parameter_vector(parameters)

    def prepare(rtol: float) -> Prepared:
        options = {"method": method, "rtol": rtol, "atol": absolute(rtol)}
        prepared = model.prepare((0.0, END), **options)

        def call() -> Any:
            return model.simulate((0.0, END), initial, parameters, **options)

        def run() -> Any:
            return prepared(state, p)

        trajectory, end = call(), run()
        if not trajectory.success:
            raise RuntimeError(f"{problem.name}, {method} at rtol {rtol:g}: {trajectory.message}")
        error = problem.error(trajectory.q[-1], trajectory.qdot[-1])
        if not np.abs(end - trajectory.y[-1]).max() <= 100 * max(error, 1e-12):
            raise RuntimeError(f"{problem.name}, {method} at rtol {rtol:g}: prepare() and simulate() end differently")
        return Prepared(run, call, error, trajectory.stats.steps, trajectory.stats.evaluations)

    return prepare
