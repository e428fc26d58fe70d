"""The loop of `dalembert.integrators.lane_loop` with projections and records of the steps of all cases."""

from .lane_loop import sweeping

__all__ = ["LOOP"]

LOOP = sweeping(watched=False, projected=True, recorded=True)
