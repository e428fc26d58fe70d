"""Functions that users give as inputs: pytrees, checked, and as functions of numbers in one array of weights."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..errors import OptionError
from ..once import once
from ..scene.symbol_table import InputSymbol
from ..stops.feedback import Feedback

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

    def function(t: Any, q: Any, qdot: Any, arrays: Any) -> Any:
        whole = _joined(fixed, arrays)
        return whole.function(t, q, qdot, *whole.arguments)

    zeros = jnp.zeros(()), jnp.zeros(n), jnp.zeros(n), [jnp.asarray(array) for array in arrays]
    pure, more = jax.closure_convert(function, *zeros)
    return Feedback(_Closed(pure), ((arrays, more),))


class _Closed:
    """A function with what it closed over as its last argument."""

    def __init__(self, pure: Callable[..., Any]) -> None:
        self._pure = pure

    def __call__(self, t: Any, q: Any, qdot: Any, theta: Any) -> Any:
        arrays, more = theta
        return self._pure(t, q, qdot, arrays, *more)


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


def function_of_weights(name: str, given: Feedback, n: int) -> Callable[..., Any]:
    """Return (t, q, qdot, weights) -> the value of the input `name`, for n coordinates; weights are `weights_of`.

    Raises
    ------
    OptionError
        For functions whose value is no number.
    """
    arrays, fixed = _split(given)
    shapes = [(np.shape(array), jnp.result_type(array)) for array in arrays]
    ends = np.cumsum([0, *(int(np.prod(shape)) for shape, _ in shapes)]).tolist()

    def function(t: Any, q: Any, qdot: Any, weights: Any) -> Any:
        parts = [
            jnp.reshape(weights[ends[i] : ends[i + 1]], shape).astype(kind) for i, (shape, kind) in enumerate(shapes)
        ]
        whole = _joined(fixed, parts)
        found = whole.function(t, q, qdot, *whole.arguments)
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
