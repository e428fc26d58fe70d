"""The loop of `dalembert.integrators.prepared_loop` with records, for single runs by Taylor steps."""

from .prepared_loop import running

__all__ = ["LOOP"]

LOOP = running(recorded=True)
