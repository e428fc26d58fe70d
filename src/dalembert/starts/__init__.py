"""Starts of runs: values by name, consistent states, the rank of constraints, first integrals that are kept.

The ways in are `inputs` and `initial_states`. It imports `codegen`, `results` and what stands above.
"""
