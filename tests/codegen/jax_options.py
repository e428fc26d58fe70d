"""Options of XLA with which tests compile programs that run only a few times."""

import pytest

jax = pytest.importorskip("jax")

__all__ = ["QUICK"]

# Versions of XLA differ in their options, and refuse a program compiled with an option that they do not have.
WISHES = {"xla_backend_optimization_level": 0, "xla_cpu_use_fusion_emitters": False}


def _accepted(name, value):
    """Return whether this version of XLA has an option."""
    try:
        jax.jit(lambda x: x + 1.0, compiler_options={name: value})(0.0)
    except jax.errors.JaxRuntimeError:
        return False
    return True


QUICK = {name: value for name, value in WISHES.items() if _accepted(name, value)}
"""Compiles several times faster than without options, to code that is slower to run."""
