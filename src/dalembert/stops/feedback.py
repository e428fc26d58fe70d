"""Inputs that are functions of time and state, for runs that JAX traces."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

from ..errors import OptionError
from ..frozen import frozen


@final
@frozen(eq=False)
class Feedback:
    """An input as a function of time and state, made by `feedback`.

    Attributes
    ----------
    function : callable
        (t, q, qdot, *arguments) -> the value of the input, a number.
    arguments : tuple
        Further arguments of the function: none, or one tree of arrays.
    """

    function: Callable[..., Any]
    arguments: tuple[Any, ...]


def feedback(function: Callable[..., Any], theta: Any = None) -> Feedback:
    """Return an input as a function of time and state, for ``solve(t, initial, p, inputs={u: feedback(f, theta)})``.

    A force that a neural network learns, a control law, a friction law: derivatives of a run pass through the function,
    by theta too, with the rules that it has of its own (``jax.lax.stop_gradient``, ``jax.custom_jvp``,
    ``jax.custom_vjp``).

    Parameters
    ----------
    function : callable
        ``function(t, q, qdot, theta)`` gives the value of the input, a number, from the time (), the coordinates (n_q,)
        and the rates (n_q,), in the order of ``layout.coordinates``; without theta, ``function(t, q, qdot)``. It is
        traced by JAX. It must be continuous: steps do not end where it jumps, and derivatives would miss the jump.
        A function that is itself a pytree, such as a module of equinox, is differentiated by its arrays too.
    theta : pytree, optional
        Weights: numbers, arrays, modules of equinox. Other leaves are constant.

    Raises
    ------
    OptionError
        For what cannot be called.
    """
    if not callable(function):
        raise OptionError(
            f"feedback takes a function (t, q, qdot, theta) -> number, not {function!r}; a number or"
            " dalembert.samples(times, values) is given to inputs= as it is"
        )
    return Feedback(function, () if theta is None else (theta,))
