"""Cases of sweeps: product grids, and random cases that are computed by their numbers, never all at once."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import field
from threading import Lock
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import ValueInputError, nesting_named
from ..frozen import frozen
from ..values import array_of, option, whole

# Product grids of values, for sweeps.


@final
@frozen(eq=False)
class Grid:
    """Every combination of some named values; the last axis varies fastest.

    Attributes
    ----------
    axes : dict of str to ndarray
        The values along each axis.
    """

    axes: dict[str, NDArray[np.float64]]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the varied quantities."""
        return tuple(self.axes)

    @property
    def shape(self) -> tuple[int, ...]:
        """Length of each axis."""
        return tuple(len(values) for values in self.axes.values())

    def columns(self) -> dict[str, NDArray[np.float64]]:
        """Return one value a case (k,) for each name."""
        mesh = np.meshgrid(*self.axes.values(), indexing="ij")
        return {name: values.ravel() for name, values in zip(self.axes, mesh, strict=True)}

    def __repr__(self) -> str:
        return f"<Grid {' x '.join(f'{name}: {len(values)}' for name, values in self.axes.items())}>"


@nesting_named
def grid(**axes: Any) -> Grid:
    """Return the product grid of named values, to be given to `CompiledModel.sweep` as ``grid=``.

    Parameters
    ----------
    **axes : array_like (k,)
        The values of each parameter or initial value that varies.

    Raises
    ------
    ValueInputError
        For an axis that is not one-dimensional, has no values, or holds what are no numbers.

    Examples
    --------
    Two angles at the start and three lengths of the pendulum of `Scene`: six cases, the length fastest::

        axes = da.grid(theta=[0.5, 1.0], l=[1.0, 2.0, 3.0])
        sweep = model.sweep((0, 10), {theta.diff(): 0}, {m: 1, g: 9.81}, grid=axes)
    """
    values, strange = {}, []
    for name, axis in axes.items():
        try:
            values[name] = np.array(array_of(axis), ndmin=1)
        except ValueError as reason:
            strange.append(f"{name} = {axis!r} {reason}")
    if strange:
        raise ValueInputError(f"the axes of a grid are arrays of numbers: {'; '.join(strange)}")
    wrong = [f"{name} has shape {axis.shape}" for name, axis in values.items() if axis.ndim != 1 or not len(axis)]
    if wrong or not values:
        given = "; ".join(wrong) or "none given"
        raise ValueInputError(f"the axes of a grid are one-dimensional arrays of values: {given}")
    return Grid(values)


_SOBOL_BITS = 32
_SOBOL_LOCK = Lock()
_BLOCK = 1024
"""Cases whose random numbers are made together; a case has the same ones whichever cases are asked for."""


@final
@frozen
class Distribution:
    """A distribution, made by `uniform` or `normal`."""

    kind: str
    first: float
    second: float

    def values(self, share: FloatArray) -> FloatArray:
        """Return the values (k,) at shares (k,) of the probability between 0 and 1."""
        if self.kind == "uniform":
            return self.first + (self.second - self.first) * share
        from scipy.special import ndtri

        tiny = np.finfo(float).tiny
        return np.asarray(self.first + self.second * ndtri(np.clip(share, tiny, 1.0 - np.finfo(float).epsneg)))


def uniform(low: float, high: float) -> Distribution:
    """Return the uniform distribution between two numbers, for `random_cases` and `sobol_cases`; see there.

    Raises
    ------
    OptionError
        For what are no finite numbers.
    """
    return Distribution("uniform", option("low", low), option("high", high))


def normal(mean: float, deviation: float) -> Distribution:
    """Return the normal distribution with a mean and a standard deviation, for `random_cases` and `sobol_cases`.

    Raises
    ------
    OptionError, ValueInputError
        For what are no finite numbers, and a standard deviation that is negative.
    """
    if not option("deviation", deviation) >= 0.0:
        raise ValueInputError(f"normal: the standard deviation must not be negative, not {deviation!r}")
    return Distribution("normal", option("mean", mean), option("deviation", deviation))


@final
@frozen(eq=False)
class CaseSampler:
    """Random cases, made by `random_cases` or `sobol_cases`.

    Attributes
    ----------
    count : int
        Number of cases.
    seed : int
    sequence : str
        "random" or "sobol".
    distributions : mapping of str to Distribution
    """

    count: int
    seed: int
    sequence: str
    distributions: Mapping[str, Distribution]
    _engine: dict[str, Any] = field(default_factory=dict, repr=False)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the varied quantities."""
        return tuple(self.distributions)

    @property
    def axes(self) -> dict[str, FloatArray]:
        """Empty, because the cases lie along one axis without values."""
        return {}

    def part(self, first: int, last: int) -> dict[str, FloatArray]:
        """Return the values of the cases from number `first` up to `last`, by name."""
        shares = self._sobol(first, last) if self.sequence == "sobol" else self._random(first, last)
        return {name: d.values(share) for (name, d), share in zip(self.distributions.items(), shares, strict=True)}

    def columns(self) -> dict[str, FloatArray]:
        """Return the values of all cases, by name."""
        return self.part(0, self.count)

    def _random(self, first: int, last: int) -> list[FloatArray]:
        blocks = range(first // _BLOCK, -(-last // _BLOCK))
        cut = slice(first - blocks.start * _BLOCK, last - blocks.start * _BLOCK)
        return [
            np.concatenate([self._block(column, block) for block in blocks])[cut] if len(blocks) else np.empty(0)
            for column in range(len(self.distributions))
        ]

    def _block(self, column: int, block: int) -> FloatArray:
        generator = np.random.Generator(np.random.Philox(key=[self.seed, column], counter=[0, 0, block, 0]))
        return generator.random(_BLOCK)

    def _sobol(self, first: int, last: int) -> list[FloatArray]:
        from scipy.stats import qmc

        with _SOBOL_LOCK, warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # a part of the sequence need not have a power of two points
            engine = self._engine.get("engine")
            if engine is None or engine.num_generated > first:  # going on is faster than beginning anew
                rng = np.random.default_rng(self.seed)
                engine = qmc.Sobol(len(self.distributions), scramble=True, rng=rng, bits=_SOBOL_BITS)
            if first > engine.num_generated:
                engine.fast_forward(first - engine.num_generated)
            self._engine["engine"] = engine
            points = engine.random(last - first) if last > first else np.empty((0, len(self.distributions)))
        return list(np.ascontiguousarray(points.T))

    def __reduce__(self) -> tuple[Any, ...]:
        return CaseSampler, (self.count, self.seed, self.sequence, self.distributions)

    def __repr__(self) -> str:
        return f"<{self.count:,} {self.sequence} cases of {', '.join(self.distributions)}, seed {self.seed}>"


CaseSet = Grid | CaseSampler
"""Sets of cases, the argument ``grid=`` of `CompiledModel.sweep`."""


def case_set(given: Any) -> CaseSet:
    """Return the set of cases of an argument ``grid=``.

    Raises
    ------
    ValueInputError
        For what none of the functions below, nor `dalembert.grid`, made.
    """
    if not isinstance(given, CaseSet):
        raise ValueInputError(
            f"grid must be made by dalembert.grid(name=values, ...), random_cases or sobol_cases, not {given!r}"
        )
    return given


@nesting_named
def random_cases(count: int, seed: int, **distributions: Distribution) -> CaseSampler:
    """Return independent random cases, to be given to `CompiledModel.sweep` as ``grid=``.

    Case i has the same values on every machine, however the cases are divided.

    Parameters
    ----------
    count : int
        Number of cases.
    seed : int
        A seed gives the same cases each time.
    **distributions : Distribution
        `uniform` or `normal`, of each parameter or initial value that varies.

    Raises
    ------
    ValueInputError
        For what is no distribution, and counts below 1.

    Examples
    --------
    Pendulums of random lengths and angles::

        cases = da.random_cases(1000, 1, l=da.uniform(0.5, 2), theta=da.normal(0, 0.1))
        sweep = model.sweep((0, 10), {theta.diff(): 0}, {m: 1, g: 9.81}, grid=cases)
    """
    return _sampler(count, seed, "random", distributions)


@nesting_named
def sobol_cases(count: int, seed: int, **distributions: Distribution) -> CaseSampler:
    """Return the cases of a scrambled Sobol sequence, which fill the space evenly.

    Arguments and errors are those of `random_cases`. A count that is a power of two is the most even.
    """
    return _sampler(count, seed, "sobol", distributions)


def _sampler(count: Any, seed: Any, sequence: str, distributions: Mapping[str, Any]) -> CaseSampler:
    number = whole("count", count)
    if number < 1:
        raise ValueInputError(f"{sequence}_cases: count must be at least 1, not {count!r}")
    if sequence == "sobol" and number > 2**_SOBOL_BITS:
        raise ValueInputError(f"sobol_cases: count must be at most {2**_SOBOL_BITS:,}, not {count!r}; use random_cases")
    if not distributions:
        raise ValueInputError(f"{sequence}_cases: give what varies, such as b=dalembert.uniform(0.1, 0.5)")
    wrong = [f"{name} = {d!r}" for name, d in distributions.items() if not isinstance(d, Distribution)]
    if wrong:
        raise ValueInputError(
            f"{sequence}_cases takes distributions, dalembert.uniform(low, high) or normal(mean, deviation), not"
            f" {'; '.join(wrong)}"
        )
    start = whole("seed", seed)
    if not 0 <= start < 2**64:
        raise ValueInputError(f"{sequence}_cases: the seed must be between 0 and 2**64, not {seed!r}")
    return CaseSampler(number, start, sequence, dict(distributions))
