"""Integrators: the initial value problem, loops in the compiled subset, SciPy's integrators, and loops that JAX traces.

Nothing here imports SciPy or JAX; the subpackages named after them do, on first use.
"""
