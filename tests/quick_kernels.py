"""Options of compilers with which tests compile much that runs only a few times."""

from contextlib import contextmanager


def are_compiled_quickly():
    """Return whether kernels are compiled so now."""
    from dalembert.codegen.llvm import assembly

    return not assembly._LONG


@contextmanager
def compiled_quickly():
    """Compile kernels of models as the package compiles long ones that run once: unscheduled.

    That is several times faster, and what it makes is half as fast. No instruction for floating-point numbers has flags
    that let LLVM change what it computes, so that the bits of results are the same (``test_quick_kernels.py``). Loops,
    which are compiled once per installation, keep their options. On disk these kernels have names of their own.
    Units and packages are compiled without optimisation, in a quarter of the time: strict C99 has the same bits so.
    Runs of pages are compiled as their finer runs are, to code that is small, in half of the time.
    """
    from dalembert.codegen.llvm import assembly, backend  # in a second or two, which not all tests need
    from dalembert.export import compilers

    kept, longest, library, fast = backend.object_code, assembly._LONG, compilers._LIBRARY, compilers._FAST

    def unscheduled(folder, name, text, shape="straight"):
        straight = shape in ("straight", "once")
        return kept(folder, f"{name}_quick" if straight else name, text, "once" if straight else shape)

    backend.object_code, assembly._LONG = unscheduled, 0
    compilers._LIBRARY = tuple("-O0" if option == "-O2" else option for option in library)
    compilers._FAST = compilers._SMALL
    try:
        yield
    finally:
        backend.object_code, assembly._LONG = kept, longest
        compilers._LIBRARY, compilers._FAST = library, fast
