"""The JAX backend: generated Python on ``jax.numpy``, compiled by XLA and integrated by diffrax."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, final

import numpy as np

from ... import __version__
from ...errors import FormulationError, MissingExtraError
from ...integrators.problem import IntegrationProblem, Solution
from ...ir.program import Program
from ...runtime.cache import load_in_memory
from ..base import Backend, Engine, FloatArray, RenderedModule
from ..printers import JAX
from ..rendering import digest_of, render_source

try:
    import diffrax
    import jax
    import jax.numpy as jnp
except ImportError as missing:
    raise MissingExtraError(
        f'the jax backend needs JAX and diffrax ({missing}): pip install "dalembert[jax]"'
    ) from missing

from ...integrators.jax.precision import double_precision
from ...integrators.jax.solvers import Integrator

__all__ = ["JaxBackend", "JaxEngine"]

_SMALLEST_BATCH = 16


def _stacked(kernel: Callable[..., tuple[Any, ...]]) -> Callable[[Any, Any, Any], Any]:
    """Return a generated kernel as a function from arrays to an array."""

    def on_arrays(t: Any, y: Any, c: Any) -> Any:
        outputs = kernel(t, jnp.unstack(y), jnp.unstack(c))
        return jnp.stack([jnp.asarray(output, dtype=jnp.float64) for output in outputs])

    return on_arrays


def _padded(rows: FloatArray, size: int) -> FloatArray:
    """Return `rows` with the last one repeated until there are `size`."""
    return np.concatenate([rows, np.repeat(rows[-1:], size - len(rows), axis=0)])


@final
class JaxEngine(Engine):
    """Kernels of a module that JAX traces; each is compiled when first used.

    Parameters
    ----------
    program : Program
        What the module was rendered from.
    namespace : mapping of str to callable
        The module's kernels by name.
    """

    def __init__(self, program: Program, namespace: Mapping[str, Any]) -> None:
        names = [kernel.name for kernel in program if kernel.name != "prepare"]
        self._sizes = {kernel.name: len(kernel.outputs) for kernel in program}
        self._kernels = {name: jax.jit(_stacked(namespace[name])) for name in names}
        self._batched = {name: jax.jit(jax.vmap(self._kernels[name], (0, 0, None))) for name in names}
        self._integrators: dict[str, Integrator] = {}

    def evaluate(self, kernel: str, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """See `Engine.evaluate`. Batches are padded to a power of two, so that few sizes are ever compiled."""
        count = len(y)
        if count == 0:
            return np.empty((0, self._sizes[kernel]))
        size = max(_SMALLEST_BATCH, 1 << (count - 1).bit_length())
        with double_precision():
            out = self._batched[kernel](_padded(t, size), _padded(y, size), c)
            return np.array(np.asarray(out)[:count])

    def integrate(self, problem: IntegrationProblem, method: str) -> Solution:
        """See `Engine.integrate`."""
        if method not in self._integrators:
            self._integrators[method] = Integrator(self._kernels["rhs"], method)
        return self._integrators[method](problem)


@final
class JaxBackend(Backend):
    """For accelerators, and for programs that are JAX already."""

    name = "jax"
    methods: ClassVar[Mapping[str, str]] = {
        "dopri8": "explicit Runge-Kutta of order 8 (Prince and Dormand; diffrax)",
        "tsit5": "explicit Runge-Kutta of order 5 (Tsitouras; diffrax)",
    }

    def render(self, program: Program, *, cache: bool) -> RenderedModule:
        """See `Backend.render`.

        Raises
        ------
        FormulationError
            When accepted steps have to be projected.
        """
        if "project_position" in program or "project_velocity" in program:
            raise FormulationError(
                f"the jax backend does not project, which the formulation {program.formulation!r} of "
                f'{program.name!r} needs. Use formulation="minimal", where the scene has it, or backend="numba".'
            )
        source = render_source("jax.py.j2", program, JAX)
        versions = f"{__version__} {jax.__version__} {diffrax.__version__}"
        return RenderedModule(self.name, program, source, digest_of(self.name, versions, source))

    def load(self, rendered: RenderedModule, *, cache: bool) -> Engine:
        """See `Backend.load`; XLA compiles in memory, so that there is nothing to keep on disk."""
        module = load_in_memory(rendered.digest, rendered.source)
        return JaxEngine(rendered.program, module.__dict__)
