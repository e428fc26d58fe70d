"""Integrators: tableaux, the problem and its solution, and one loop per backend.

Nothing here imports numba, SciPy or JAX; the subpackages named after them do, when they are asked for.
"""
