"""What a backend is: it renders a program as a module, loads it, and runs its kernels."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from ..ir.program import Program

if TYPE_CHECKING:
    from ..integrators.problem import IntegrationProblem, Solution

__all__ = ["Backend", "Engine", "FloatArray", "RenderedModule"]

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True)
class RenderedModule:
    """The text of a generated module.

    Attributes
    ----------
    backend : str
        Name of the backend that rendered it and can load it.
    program : Program
        What it was rendered from.
    source : str
        The text; the same scene gives the same text in every process.
    digest : str
        Digest of the text, of the integrator sources and of the versions that compiled code depends on.
    """

    backend: str
    program: Program
    source: str
    digest: str


class Engine(ABC):
    """A loaded module: kernels that can be called, and the integrators that call them."""

    @abstractmethod
    def evaluate(self, kernel: str, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """Return the outputs (k, n_out) of a kernel at times t (k,), states y (k, n) and constants c (n_c,)."""

    def prepare(self, problem: IntegrationProblem, method: str) -> None:  # noqa: B027
        """Compile what `integrate` will need for such a problem, where that is still to be done."""

    @abstractmethod
    def integrate(self, problem: IntegrationProblem, method: str) -> Solution:
        """Return the solution of an initial value problem in the state of the formulation."""


class Backend(ABC):
    """A way to print, load and integrate. Adding one is one module, one template folder, one registry line."""

    name: ClassVar[str]
    methods: ClassVar[Mapping[str, str]]
    """Integration methods by name, each with one line of description; the first is what "auto" takes."""

    @abstractmethod
    def render(self, program: Program, *, cache: bool) -> RenderedModule:
        """Return the module of a program. `cache` says whether compiled code may be kept on disk."""

    @abstractmethod
    def load(self, rendered: RenderedModule, *, cache: bool) -> Engine:
        """Return the module ready to run, from the cache on disk where `cache` allows."""
