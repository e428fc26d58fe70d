"""The numba backend: generated modules of Python that numba compiles."""
