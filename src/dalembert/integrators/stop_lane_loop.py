"""The loop of `dalembert.integrators.lane_loop` with stops."""

from .lane_loop import sweeping

__all__ = ["LOOP"]

LOOP = sweeping(watched=False, projected=True, stops=True)
