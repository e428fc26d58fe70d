"""The loop of `dalembert.integrators.lane_loop` with events and reductions."""

from .lane_loop import sweeping

__all__ = ["LOOP"]

SHAPE = "branches"
LOOP = sweeping(watched=True, projected=True)
