"""Linear maps as operations of JAX: nested derivatives are those of plain JAX."""

from dataclasses import dataclass

import numpy as np
import pytest

jax = pytest.importorskip("jax")

from dalembert.jax.runs.linear_maps import apply  # noqa: E402

pytestmark = pytest.mark.usefixtures("quick_xla")

A = np.arange(9.0).reshape(3, 3) / 7.0
X = np.array([0.1, 0.2, 0.4])


@dataclass(frozen=True)
class Product:
    """A matrix times a vector."""

    back: bool = False

    def __call__(self, held, moving):
        matrix = held["matrix"].T if self.back else held["matrix"]
        return (matrix @ moving[0],)

    @property
    def transposed(self):
        return Product(not self.back)

    def change(self, held, dheld, moving, still):
        assert not still["matrix"]
        return self(dheld, moving)


def own(a, x):
    back = apply(Product(back=True), {"matrix": a}, (x,))[0]
    return jax.numpy.sin(apply(Product(), {"matrix": a}, (jax.numpy.cos(back),))[0]).sum()


def plain(a, x):
    return jax.numpy.sin(a @ jax.numpy.cos(a.T @ x)).sum()


def nested(*kinds):
    def differentiated(function):
        for kind in kinds:
            function = kind(function, argnums=(0, 1))
        return function

    return differentiated


F, R = jax.jacfwd, jax.jacrev


@pytest.mark.parametrize("kinds", [(F,), (R,), (F, F), (F, R), (R, F), (R, R), (R, F, F)])
def test_nested_derivatives(kinds):
    with jax.enable_x64(True):
        found, expected = (jax.jit(nested(*kinds)(function))(A, X) for function in (own, plain))
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-13), found, expected)


@pytest.mark.parametrize("axes", [(None, 0), (0, None), (2, 1)])
def test_batches_of_gradients_with_arguments_in_common(axes):
    given = [
        np.stack([value, 2.0 * value], axis=axis) if axis is not None else value
        for value, axis in zip((A, X), axes, strict=True)
    ]
    with jax.enable_x64(True):
        found, expected = (jax.jit(jax.vmap(jax.grad(f, argnums=(0, 1)), axes))(*given) for f in (own, plain))
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-14), found, expected)
