"""The loop of `dalembert.integrators.lane_loop` with inputs that have knots."""

from .lane_loop import sweeping

__all__ = ["LOOP"]

LOOP = sweeping(watched=False, projected=True, knots=True)
