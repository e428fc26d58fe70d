"""The loop of `dalembert.integrators.lane_loop` with events and reductions."""

from .lane_loop import kinds, sweeping

__all__ = ["KINDS", "LOOP"]

LOOP, KINDS = sweeping(watched=True, projected=True), kinds(watched=True)
