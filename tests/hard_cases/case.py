"""`HardCase`: a motion that is hard to simulate, with reference values and bounds.

One file a family, all registered in `hard_cases.CASES`, over which the tests and the report
`docs/hard_cases.md` run.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, final

import numpy as np

import dalembert as da
from quick_kernels import are_compiled_quickly

__all__ = ["HardCase", "published_reference", "reference"]


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class HardCase:
    """A motion with reference values.

    Attributes
    ----------
    scene : Scene
        In the user's language.
    parameters, initial : mapping of symbols or names to numbers
        As for `simulate`.
    observed : sequence of names and expressions of the scene's symbols
        The reference quantities.
    quantity : str
        What is observed, in words, where names do not say it.
    values : mapping of float to sequence
        Time -> the reference values of what is observed, as numbers or strings of digits.
    source : str
        Where the values come from.
    bound : float
        Largest error allowed, over max(scale, size of the value).
    scale : sequence of float
        Sizes below which errors of the observed quantities count absolutely; 1 by default.
    refused : mapping of str to str
        Formulations that cannot serve the scene, and a part of the reason that they give.
    conserved : sequence of names and expressions
        First integrals.
    drift : float
        Largest change allowed of any of them, over max(1, its size), up to the last time.
    rtol, atol : float
        Tolerances of the run.
    report_only : sequence of float
        Times that only the report runs to.
    may_fail : str
        Why a run may end with another status than success; its answer may not be wrong all the same.
    """

    scene: da.Scene
    parameters: Mapping[Any, float]
    initial: Mapping[Any, float]
    observed: Sequence[Any]
    values: Mapping[float, Sequence[Any]]
    source: str
    bound: float
    quantity: str = ""
    scale: Sequence[float] = ()
    refused: Mapping[str, str] = field(default_factory=dict)
    conserved: Sequence[Any] = ("energy",)
    drift: float = 1e-12
    rtol: float = 1e-15
    atol: float = 1e-17
    report_only: Sequence[float] = ()
    may_fail: str = ""

    @property
    def outputs(self) -> list[Any]:
        """What a model must be compiled with."""
        return [x for x in dict.fromkeys((*self.observed, *self.conserved)) if x != "energy"]

    def times(self, *, all_of_them: bool = False) -> list[float]:
        """Return the times of the reference values, in order."""
        return sorted(t for t in self.values if all_of_them or t not in self.report_only)

    def compile(self, formulation: str, backend: str = "llvm") -> Any:
        """Return the scene compiled with everything that is observed, once a process for all cases that share it."""
        return _compiled(self.scene, backend, formulation, tuple(self.outputs), are_compiled_quickly())

    def simulate(self, model: Any, *, method: str = "auto", all_of_them: bool = False, **options: Any) -> Any:
        """Simulate to the last time; the start is recorded too."""
        times = [0.0, *self.times(all_of_them=all_of_them)]
        options = {"rtol": self.rtol, "atol": self.atol, "max_steps": 10_000_000, "dense": False} | options
        span = (0.0, times[-1])
        return model.simulate(span, self.initial, self.parameters, t_eval=times, method=method, **options)

    def observe(self, run: Any) -> np.ndarray:
        """Return the observed quantities (n_times, n_observed) after the start."""
        return np.column_stack([run[x] for x in self.observed])[1:]

    def expected(self, times: Sequence[float]) -> np.ndarray:
        """Return the reference values (n_times, n_observed)."""
        return np.array([[float(x) for x in self.values[t]] for t in times])

    def sizes(self, values: np.ndarray) -> np.ndarray:
        """Return what errors of these values are taken relative to."""
        scale = np.asarray(self.scale) if len(self.scale) else np.ones(values.shape[1])
        return np.maximum(scale, np.abs(values))

    def error(self, run: Any) -> float:
        """Return the largest scaled error at the times that the run recorded."""
        expected = self.expected(list(run.t[1:]))
        return float(np.max(np.abs(self.observe(run) - expected) / self.sizes(expected)))

    def change(self, run: Any) -> float:
        """Return the largest change of a first integral since the start.

        That of the energy is relative to the largest kinetic or total energy, others to max(1, their size).
        """
        changes = [0.0]
        for x in self.conserved:
            values = run[x]
            size = max(abs(values[0]), np.max(run["kinetic_energy"]) if x == "energy" else 1.0)
            changes.append(float(np.max(np.abs(values - values[0])) / size))
        return max(changes)


@cache
def _compiled(scene: da.Scene, backend: str, formulation: str, outputs: tuple[Any, ...], quickly: bool) -> Any:
    return da.compile_model(scene, backend=backend, formulation=formulation, outputs=outputs)


@cache
def _references(file: str = "references.json") -> dict[str, Any]:
    return json.loads(Path(__file__).with_name(file).read_text())


def reference(name: str) -> Any:
    """Return an entry of ``references.json``: ``values`` as digits, and their ``source``."""
    return _references()[name]


def published_reference(name: str) -> Any:
    """Return an entry of ``published_references.json``, of the same form."""
    return _references("published_references.json")[name]
