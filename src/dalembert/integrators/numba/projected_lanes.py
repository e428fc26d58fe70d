"""The loop of `dalembert.integrators.numba.lanes` with projections."""

from .lanes import kinds, sweeping

__all__ = ["KINDS", "LOOP"]

LOOP, KINDS = sweeping(watched=False, projected=True), kinds(watched=False)
