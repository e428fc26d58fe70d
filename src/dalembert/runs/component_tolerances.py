"""Absolute tolerances of components: their names, those that serve motions of some sizes, and a warning.

Where a scene has components of very different sizes, one tolerance is too large for some, or too small for others, and
Taylor steps, whose error is a share of the largest component, lose the small ones whatever it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import PrecisionWarning, warn_caller
from ..options import DEFAULT_TOLERANCES, NamedTolerances, RunOptions, known_components
from ..values import number

if TYPE_CHECKING:
    from ..model.model import CompiledModel
    from ..results.sweep import Sweep
    from ..results.trajectory import Trajectory

_Options = TypeVar("_Options", bound=RunOptions)

ROUNDING = 1e-15
"""Starts up to this size are zero but for rounding."""
_NOISE = 1e-13
"""Share of the largest component that rounding may make of one which is zero."""
SHARE = 1e-2
"""Share of rtol and the size of a motion that is the absolute tolerance which serves."""
FEW = 100.0
"""Absolute tolerances within which a motion is small: an oscillator of that size was 2e-4 to 2e-2 of its size off."""
_APART = 1e-3
"""Share of the largest component below which Taylor steps at one tolerance lose digits of a small one."""


def with_component_names(model: CompiledModel, options: _Options) -> _Options:
    """Return options whose absolute tolerances by name are of components of the state, by their names.

    Raises
    ------
    UnknownNameError, OptionError
        For names that are none, and components that are given twice.
    """
    return replace(options, atol=with_names(model, options.atol)) if is_by_name(options.atol) else options


def is_by_name(atol: Any) -> bool:
    """Whether absolute tolerances are given by name."""
    return isinstance(atol, NamedTolerances)


def with_names(model: CompiledModel, atol: float) -> float:
    """Return absolute tolerances, those by name under the names of components; errors as `with_component_names`."""
    layout = model.layout
    why = f" It is none in the formulation {model.formulation!r}, where it follows from the components of the state."
    others = {name: why for name in layout.variables if name not in layout.state}
    return known_components(atol, layout.state, layout.aliases, others)


def serving_atol(rtol: float, size: float) -> float:
    """Return the absolute tolerance that serves motions of a size, the same for all of one decade."""
    return float(SHARE * rtol * 10.0 ** math.floor(math.log10(size)))


def decides(atol: Any, rtol: float, size: Any) -> Any:
    """Whether `atol`, and not `rtol`, decides the errors of motions of a size."""
    return rtol * size < atol


def component_sizes(run: Trajectory) -> dict[str, float]:
    """Return the largest magnitude of each component of the state along a motion, by name."""
    sizes: dict[str, float] = {}
    for part in run.parts:
        found = np.max(np.abs(part.y), axis=0, initial=0.0).tolist()
        for name, size in zip(part.program.layout.state, found, strict=True):
            sizes[name] = max(size, sizes.get(name, 0.0))
    return sizes


def case_sizes(sweep: Sweep) -> dict[str, float]:
    """Return the largest magnitude of each component of the state at the ends of cases, by name."""
    return dict(zip(sweep.components, np.nanmax(np.abs(sweep.y), axis=0, initial=0.0).tolist(), strict=True))


def serving_components(run: Trajectory, initial: Mapping[Any, Any], rtol: float) -> NamedTolerances | None:
    """Return tolerances of the components that serve a motion; None where its own do.

    A component has the size of its given initial value, if that is beyond rounding, and else of its motion.
    """
    sizes, used, aliases = component_sizes(run), run.stats.atol, run.parts[0].program.layout.aliases
    starts = {aliases.get(str(key), str(key)): abs(number(value)) for key, value in initial.items()}
    names = list(sizes)
    row = np.array([[sizes[name] for name in names]])
    given = np.array([[starts.get(name, 0.0) for name in names]])
    own = used.of(names) if isinstance(used, NamedTolerances) else np.full(len(names), used)
    by_largest = "taylor" in run.stats.method and not is_by_name(used)
    wanted, served = _serving(row, given, own, rtol, by_largest)
    if served[0]:
        return None
    return _named(names, wanted[0], float(np.min(own)))


def case_components(
    sweep: Sweep, used: FloatArray, rtol: float, most: int
) -> Iterator[tuple[NDArray[np.bool_], NamedTolerances]]:
    """Yield which cases (k,) of a sweep need tolerances of components, and these; all at once if there are many.

    `used` (k,) are the tolerances that they took.
    """
    names, samples = list(sweep.components), sweep.samples
    sizes = np.abs(sweep.y)
    if samples is not None:
        sizes = np.fmax(sizes, np.nanmax(np.abs(samples), axis=1, initial=0.0))
    given = np.zeros_like(sizes)
    for i, name in enumerate(names):
        given[:, i] = np.abs(sweep.initial.get(name, 0.0))
    wanted, served = _serving(np.nan_to_num(sizes), given, used[:, np.newaxis], rtol, "taylor" in sweep.stats.method)
    left = np.flatnonzero(~served & sweep.success)
    rows, which = np.unique(np.nan_to_num(wanted[left]), axis=0, return_inverse=True)
    if len(rows) > most:
        rows, which = np.where(rows > 0.0, rows, np.inf).min(axis=0, keepdims=True), np.zeros(len(left), int)
        rows[~np.isfinite(rows)] = 0.0
    for number_of_row, row in enumerate(rows):
        some = np.zeros(len(sizes), bool)
        some[left[which.ravel() == number_of_row]] = True
        yield some, _named(names, row, float(np.min(used[some])))


def _serving(
    sizes: FloatArray, given: FloatArray, used: FloatArray, rtol: float, by_largest: bool
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return tolerances (k, n) that serve components of sizes (k, n), 0 for those that do not count; and who is served.

    `given` (k, n) are initial values, `used` the tolerances that the motions took, with errors `by_largest` component
    in Taylor steps. Components that are zero but for rounding do not count.
    """
    largest = np.max(sizes, axis=1, initial=0.0, keepdims=True)
    counts = (sizes > ROUNDING) & (sizes > _NOISE * largest)
    sizes = np.where(counts & (given > ROUNDING), given, sizes)
    small = decides(used, rtol, sizes)
    if by_largest:
        small |= (sizes < _APART * largest) & decides(DEFAULT_TOLERANCES[1], rtol, sizes)
    with np.errstate(divide="ignore"):
        decades = 10.0 ** np.floor(np.log10(np.where(counts, sizes, 1.0)))
    return np.where(counts, SHARE * rtol * decades, 0.0), ~np.any(counts & small, axis=1)


def _named(names: list[str], row: FloatArray, default: float) -> NamedTolerances:
    """Return tolerances (n,) by name; those that are 0 are the default."""
    pairs = zip(names, row.tolist(), strict=True)
    return NamedTolerances({name: value for name, value in pairs if value > 0.0}, default)


def warn_of_components(sizes: Mapping[str, float], rtol: float, atol: NamedTolerances) -> None:
    """Warn of components of a motion whose tolerance was left out, and that stay small against the default."""
    noise = max(ROUNDING, _NOISE * max(sizes.values(), default=0.0))
    small = {
        name: size for name, size in sizes.items() if name not in atol.by_name and noise < size < FEW * atol.default
    }
    if small:
        found = ", ".join(f"{name} (up to {size:.2g})" for name, size in small.items())
        serving = ", ".join(f'"{name}": {SHARE * rtol * size:.0e}' for name, size in small.items())
        warn_caller(
            f"atol by name leaves out components that are small against the default {atol.default:g}, which allows"
            f" errors of a large share of them: {found}. Give them one, too, such as {serving}",
            PrecisionWarning,
        )
