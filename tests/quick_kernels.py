"""Options of LLVM's code generator with which tests compile many kernels that run only a few times."""

from contextlib import contextmanager


@contextmanager
def compiled_quickly():
    """Compile kernels of models as the package compiles long ones that run once: unscheduled.

    That is several times faster, and what it makes is half as fast. No instruction for floating-point numbers has flags
    that let LLVM change what it computes, so that the bits of results are the same (``test_quick_kernels.py``). Loops,
    which are compiled once per installation, keep their options. On disk these kernels have names of their own.
    """
    from dalembert.codegen.llvm import assembly, backend  # in a second or two, which not all tests need

    kept, longest = backend.object_code, assembly._LONG

    def unscheduled(folder, name, text, shape="straight"):
        straight = shape in ("straight", "once")
        return kept(folder, f"{name}_quick" if straight else name, text, "once" if straight else shape)

    backend.object_code, assembly._LONG = unscheduled, 0
    try:
        yield
    finally:
        backend.object_code, assembly._LONG = kept, longest
