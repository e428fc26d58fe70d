"""The loop of `dalembert.integrators.lane_loop` with projections."""

from .lane_loop import kinds, sweeping

__all__ = ["KINDS", "LOOP"]

LOOP, KINDS = sweeping(watched=False, projected=True), kinds(watched=False)
