"""The loop of `dalembert.integrators.numba.lanes` with events and reductions."""

from .lanes import kinds, sweeping

__all__ = ["KINDS", "LOOP"]

LOOP, KINDS = sweeping(watched=True, projected=True), kinds(watched=True)
