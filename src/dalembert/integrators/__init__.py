"""Integrators: the initial value problem, loops in the compiled subset, SciPy's and diffrax's integrators.

Nothing here imports SciPy or JAX; the subpackages named after them do, on first use.
"""
