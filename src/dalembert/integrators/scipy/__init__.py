"""SciPy's integrators, for kernels that are plain Python functions."""
