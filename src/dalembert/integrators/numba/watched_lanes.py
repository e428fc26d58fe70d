"""The loop of `dalembert.integrators.numba.lanes` with events and reductions."""

from .lanes import KINDS, sweeping

__all__ = ["KINDS", "LOOP"]

LOOP = sweeping(watched=True)
