"""Interface of a backend: rendering a program as a module, loading it, and what it can do."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from enum import Enum
from typing import ClassVar, final

from ..errors import FormulationError, list_names
from ..frozen import frozen
from ..ir.calls import function_of
from ..ir.kernel import calls_in
from ..ir.program import Program
from ..once import once_property
from .engine import Engine


@final
@frozen
class RenderedModule:
    """The text of a generated module.

    Attributes
    ----------
    backend : str
        Name of the backend that rendered it and can load it.
    program : Program
        The rendered program.
    write : function without arguments
        Prints the text; the same scene gives the same text in every process.
    digest : str
        Digest of the text, of the integrator sources and of the versions that compiled code depends on.
    """

    backend: str
    program: Program
    write: Callable[[], str]
    digest: str

    @once_property
    def source(self) -> str:
        """The text."""
        return self.write()


class Capability(Enum):
    """Abilities of some backends beyond simulation; the values are the texts of rejections."""

    KERNEL_FUNCTIONS = 'model.kernels are functions of numba: compile with backend="numba"'
    VECTOR_FIELD = 'vector_field is for programs in JAX: compile with backend="jax"'
    STATE_FUNCTIONS = 'model.functions are for programs in JAX: compile with backend="jax"'
    SOLVE_FUNCTION = 'solve_fn is for programs in JAX: compile with backend="jax"'


class Backend(ABC):
    """A way to print, load and integrate. Adding one is one module, one template folder, one registry line."""

    name: ClassVar[str]
    for_stages: ClassVar[tuple[str, ...]] = ()
    """Methods of the backend that integrate systems of index 2."""

    series: ClassVar[tuple[str, ...]] = ()
    """Methods of the backend that take one power series over a whole step."""

    capabilities: ClassVar[frozenset[Capability]] = frozenset()
    """Its abilities beyond simulation."""

    largest: ClassVar[int] = 0
    """Operations of a right-hand side that are compiled in about a minute; 0 where there is no such limit."""

    @property
    @abstractmethod
    def methods(self) -> Mapping[str, str]:
        """Integration methods by name, each with one line of description; the first is what "auto" takes."""

    def serving(self, program: Program) -> Mapping[str, str]:
        """Return the methods that can integrate a program.

        Raises
        ------
        FormulationError
            Where there is none.
        """
        if "stages" not in program and not calls_in(program.kernel("rhs")):
            return self.methods
        if "stages" not in program:
            return {name: text for name, text in self.methods.items() if name not in self.series}
        if not self.for_stages:
            raise FormulationError(
                f"the {self.name} backend has no implicit method for the formulation {program.formulation!r} of"
                f' {program.name!r}. Use formulation="minimal" or "projected", or backend="llvm"'
            )
        return {name: self.methods[name] for name in self.for_stages}

    def long_compilation(self, program: Program) -> str:
        """Return the text of the warning for equations that take minutes to compile; empty for others."""
        operations = len(program.kernel("rhs").body) if "rhs" in program else 0
        if not self.largest or operations <= self.largest:
            return ""
        return (
            f"scene {program.name!r}: its right-hand side has {operations:,} operations, and the {self.name} backend"
            f' takes minutes to compile more than {self.largest:,}. backend="llvm" takes seconds, and'
            ' backend="numpy" does not compile'
        )

    def refusal(self, program: Program, method: str) -> str:
        """Return why a method does not integrate a program; empty where nothing is known against it."""
        if method not in self.methods:
            return ""
        if calls_in(program.kernel("rhs")) and method in self.series:
            names = list_names(repr(function_of(key).name) for key in calls_in(program.kernel("rhs")))
            return f"{method!r} takes power series, and compiled functions ({names}) have none"
        return f"{method!r} cannot solve for the multipliers that {program.formulation!r} has in its stages"

    @abstractmethod
    def render(self, program: Program) -> RenderedModule:
        """Return the module of a program."""

    @abstractmethod
    def load(self, rendered: RenderedModule, *, cache: bool) -> Engine:
        """Return the module ready to run, from the cache on disk where `cache` allows."""
