"""Options of XLA with which tests compile programs that run only a few times."""

import sys
from contextlib import contextmanager

import pytest

jax = pytest.importorskip("jax")

from jax._src import compiler  # noqa: E402

__all__ = ["QUICK", "compiled_quickly"]

# Versions of XLA differ in their options, and refuse a program compiled with an option that they do not have.
WISHES = {
    "xla_backend_optimization_level": 0,
    "xla_llvm_disable_expensive_passes": True,
    "xla_cpu_use_fusion_emitters": False,
    "xla_cpu_parallel_codegen_split_count": 1,  # parts of a program that are compiled side by side
}


def _accepted(name, value):
    """Return whether this version of XLA has an option."""
    try:
        jax.jit(lambda x: x + 1.0, compiler_options={name: value})(0.0)
    except jax.errors.JaxRuntimeError:
        return False
    return True


QUICK = {name: value for name, value in WISHES.items() if _accepted(name, value)}
"""Compiles several times faster than without options, to code that is slower to run."""


def _forget():
    """Let go of every compiled program, and of weights that were fitted to what one of them computed."""
    if not _COMPILED:
        return
    _COMPILED.clear()
    jax.clear_caches()
    if solvers := sys.modules.get("dalembert.jax.runs.solvers"):
        solvers._weights.cache_clear()


_COMPILED = [True]
"""Holds something if anything may have been compiled since `_forget`, which takes a tenth of a second."""

_ORIGINAL = getattr(compiler, "get_compile_options", None)


def _plain(*arguments, **options):
    _COMPILED[:] = [True]
    return _ORIGINAL(*arguments, **options)


@contextmanager
def compiled_quickly():
    """Compile with `QUICK` what XLA compiles inside, the library's own programs too, which take no options of tests.

    JAX has no setting for all of these options, so that its function of them is replaced; where a version of JAX has
    no such function, programs are compiled as usual. All are forgotten before and after, so that no result depends on
    what ran earlier in the same process.
    """
    if _ORIGINAL is None:
        yield
        return

    def quick(*arguments, **options):
        found = _plain(*arguments, **options)
        own = dict(found.env_option_overrides)
        # Without the emitters, a program in which nothing is fused takes longer to compile, not shorter.
        left_out = {"xla_cpu_use_fusion_emitters"} if "xla_disable_hlo_passes" in own else set()
        wanted = {name: value for name, value in QUICK.items() if name not in left_out}
        found.env_option_overrides = list((wanted | own).items())
        return found

    _forget()
    compiler.get_compile_options = quick
    try:
        yield
    finally:
        compiler.get_compile_options = _plain
        _forget()
