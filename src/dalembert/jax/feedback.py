"""Functions that users give as inputs: pytrees, checked; and kernels that are given them, evaluated first."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, final

import jax
import jax.numpy as jnp
import numpy as np

from ..errors import OptionError
from ..frozen import frozen
from ..once import once
from ..scene.symbol_table import InputSymbol
from ..stops.feedback import Feedback
from .runs.mesh_axes import stack
from .runs.run_constants import Function, OnArrays
from .runs.step_rules import Rows

_CALL = "(t, q, qdot, theta), or (t, q, qdot) without theta"


def _is_array(leaf: Any) -> bool:
    return isinstance(leaf, jax.Array | np.ndarray | np.generic | float)


def _split(given: Feedback) -> tuple[list[Any], tuple[Any, ...]]:
    """Return the arrays that a function hangs on, and all else: the tree, which leaves are arrays, the other leaves."""
    leaves, tree = jax.tree.flatten((given.function, given.arguments))
    marks = tuple(map(_is_array, leaves))
    arrays = [leaf for leaf, yes in zip(leaves, marks, strict=True) if yes]
    return arrays, (tree, marks, tuple(leaf for leaf, yes in zip(leaves, marks, strict=True) if not yes))


def _joined(fixed: tuple[Any, ...], arrays: Any) -> Feedback:
    tree, marks, others = fixed
    of_arrays, of_others = iter(arrays), iter(others)
    return Feedback(*jax.tree.unflatten(tree, [next(of_arrays if yes else of_others) for yes in marks]))


def _called(fixed: tuple[Any, ...], arrays: Any, t: Any, q: Any, qdot: Any) -> Any:
    whole = _joined(fixed, arrays)
    return whole.function(t, q, qdot, *whole.arguments)


@once
def register_feedback() -> None:
    """Register functions as inputs as pytrees, whose leaves are the arrays that they depend on."""
    jax.tree_util.register_pytree_node(Feedback, _split, _joined)


def checked_feedback(symbol: InputSymbol, given: Any, n: int) -> Feedback:
    """Return a user's function for an input, of n coordinates, with the values that it closes over as arguments.

    Raises
    ------
    OptionError
        For functions of other arguments, those that cannot be compared, and inputs whose rates are needed.
    """
    given = given if isinstance(given, Feedback) else Feedback(given, ())
    name = symbol.name
    if symbol.smoothness >= 0:
        raise OptionError(
            f"input {name!r} cannot be a function of the state, as {symbol.where} depends on it, and needs its rate:"
            " give a number or dalembert.samples(times, values, 'cubic')"
        )
    try:
        inspect.signature(given.function).bind(0.0, 0.0, 0.0, *given.arguments)
    except TypeError as reason:
        raise OptionError(
            f"the function of input {name!r} is called as {_CALL}, and does not take that: {reason}. Without theta give"
            " it as it is, with theta as dalembert.feedback(function, theta)"
        ) from None
    except ValueError:  # a builtin, whose arguments are not known
        pass
    arrays, fixed = _split(given)
    try:
        hash(fixed)
    except TypeError as reason:
        raise OptionError(
            f"the function of input {name!r} holds what is neither an array nor constant ({reason}): theta may hold"
            " arrays, floating point numbers, and hashable values that stay the same"
        ) from None
    if not any(isinstance(leaf, jax.core.Tracer) for leaf in _closed_over(given.function)):
        return given

    zeros = [jnp.asarray(array) for array in arrays], jnp.zeros(()), jnp.zeros(n), jnp.zeros(n)
    pure, more = jax.closure_convert(partial(_called, fixed), *zeros)
    return Feedback(_Closed(pure), ((arrays, more),))


class _Closed:
    """A function with what it closed over as its last argument."""

    def __init__(self, pure: Callable[..., Any]) -> None:
        self._pure = pure

    def __call__(self, t: Any, q: Any, qdot: Any, theta: Any) -> Any:
        arrays, more = theta
        return self._pure(arrays, t, q, qdot, *more)


def _closed_over(function: Any, depth: int = 4) -> Iterator[Any]:
    """Return the leaves of what a function closes over, of functions in it, too."""
    held = [cell.cell_contents for cell in getattr(function, "__closure__", None) or () if _filled(cell)]
    held += [getattr(function, "__self__", None), getattr(function, "__defaults__", None)]
    if isinstance(function, partial):
        held += [function.func, function.args, function.keywords]
    if isinstance(function, jax.custom_jvp | jax.custom_vjp):
        held.append(function.fun)
    for leaf in jax.tree.leaves(held):
        yield leaf
        if callable(leaf) and depth:
            yield from _closed_over(leaf, depth - 1)


def _filled(cell: Any) -> bool:
    try:
        cell.cell_contents  # noqa: B018
    except ValueError:  # of a function that is not defined yet
        return False
    return True


def weights_of(given: Feedback) -> Any:
    """Return the arrays that a function hangs on, side by side (n_w,)."""
    arrays = [jnp.ravel(jnp.asarray(array)).astype(float) for array in _split(given)[0]]
    return jnp.concatenate(arrays) if arrays else jnp.zeros(0)


def function_of_weights(name: str, given: Feedback, n: int, first: int = 0) -> Callable[..., Any]:
    """Return (t, q, qdot, weights) -> the value of the input `name`, for n coordinates.

    Its own weights, as `weights_of` has them, begin at number `first`.

    Raises
    ------
    OptionError
        For functions whose value is no number.
    """
    arrays, fixed = _split(given)
    shapes = [(np.shape(array), jnp.result_type(array)) for array in arrays]
    ends = np.cumsum([first, *(int(np.prod(shape)) for shape, _ in shapes)]).tolist()

    def function(t: Any, q: Any, qdot: Any, weights: Any) -> Any:
        parts = [
            jnp.reshape(weights[ends[i] : ends[i + 1]], shape).astype(kind) for i, (shape, kind) in enumerate(shapes)
        ]
        found = _called(fixed, parts, t, q, qdot)
        shape = getattr(found, "shape", np.shape(found) if isinstance(found, float | int) else None)
        if shape != () or not jnp.issubdtype(jnp.result_type(found), jnp.number) or jnp.iscomplexobj(found):
            what = f"shape {shape}" if shape is not None else f"{type(found).__name__}"
            raise OptionError(
                f"the function of input {name!r} must return one real number, of shape (), not {what}: take one"
                " component, function(...)[0], or give each input a function of its own"
            )
        return jnp.asarray(found, dtype=float)

    point = jnp.zeros(()), jnp.zeros(n), jnp.zeros(n), jnp.zeros(ends[-1])
    if _reversed_only(jax.make_jaxpr(function)(*point)):
        return _pushed_too(name, function)
    return function


def _reversed_only(code: Any) -> bool:
    """Return whether code, or code among parameters, holds functions with derivatives in reverse mode alone."""
    code = getattr(code, "jaxpr", code)
    return any(
        "custom_vjp" in line.primitive.name or any(map(_reversed_only, jax.tree.leaves(list(line.params.values()))))
        for line in getattr(code, "eqns", ())
    )


def _pushed_too(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function with the derivatives that it has in reverse mode, in both modes: their transpose."""
    both = jax.custom_jvp(function)

    @both.defjvp
    def _(values: Any, tangents: Any) -> tuple[Any, Any]:
        value, pull = jax.vjp(function, *values)
        try:
            (change,) = jax.linear_transpose(pull, value)(tangents)
        except (NotImplementedError, TypeError, AssertionError, ValueError) as error:
            raise OptionError(
                f"the function of input {name!r} has a rule of its own for reverse mode (jax.custom_vjp) that is not"
                f" linear in the cotangent, and is no derivative ({type(error).__name__}): apply it to the gradient of"
                " the run instead"
            ) from error
        return value, change

    return both


@final
@frozen(eq=False)
class FeedbackKernels:
    """The inputs of a run that are functions, put among the constants that kernels take.

    Constants come with the weights of all functions behind them (see `dalembert.jax.runs.run_constants`).

    Attributes
    ----------
    functions : tuple of callable
        (t, q, qdot, weights) -> the value of each input, weights those of all.
    places : tuple of int
        Numbers of the constants that are these values.
    start : int
        Number of the constant which is the start of the run.
    n : int
        How many coordinates there are.
    expand : callable
        (t, y, c) -> coordinates and rates, on rows.
    expand_one : callable
        The same on arrays.
    """

    functions: tuple[Callable[..., Any], ...]
    places: tuple[int, ...]
    start: int
    n: int
    expand: Function
    expand_one: OnArrays

    def on_rows(self, kernel: Function) -> Function:
        """Return a kernel on rows that takes weights behind its constants."""
        return lambda t, y, c: kernel(t, y, self._rows(t, y, c))

    def on_one_row(self, kernel: Function) -> Function:
        """Return a kernel on one row that takes weights as a second row of constants."""

        def run(t: Any, y: Rows, c: Rows) -> Rows:
            given, weights = c
            x = self.expand_one(t, y[0], given)
            values = self.values(given[self.start] + t, x[: self.n], x[self.n : 2 * self.n], weights)
            return kernel(t, y, (given.at[jnp.array(self.places)].set(values),))

        return run

    def values(self, t: Any, q: Any, qdot: Any, weights: Any) -> Any:
        """Return the values of the inputs (n_functions,) at one time."""
        return stack([function(t, q, qdot, weights) for function in self.functions])

    def at_times(self, t: Any, q: Any, qdot: Any, rows: Any, weights: Any) -> Any:
        """Return constants of kernels (n_t, n) with the values at times t (n_t,), q and qdot (n_t, n_q)."""
        values = jax.vmap(self.values, (0, 0, 0, None))(t, q, qdot, weights)
        rows = jnp.broadcast_to(rows, (len(t), rows.shape[-1]))
        return rows.at[:, jnp.array(self.places)].set(values)

    def _rows(self, t: Any, y: Rows, c: Rows) -> Rows:
        *given, weights = c
        x = self.expand(t, y, given)[: 2 * self.n]
        time = given[self.start] + t
        shape = jnp.broadcast_shapes(jnp.shape(time), *map(jnp.shape, x))
        flat = [jnp.ravel(jnp.broadcast_to(row, shape)) for row in (time, *x)]
        q, qdot = stack(flat[1 : self.n + 1], axis=-1), stack(flat[self.n + 1 :], axis=-1)
        of_cases = 0 if jnp.ndim(weights) == 2 else None
        values = jax.vmap(self.values, (0, 0, 0, of_cases))(flat[0], q, qdot, weights)
        for i, place in enumerate(self.places):
            given[place] = jnp.reshape(values[:, i], shape)
        return tuple(given)
