"""The JAX backend: functions that users trace, and calls of machine code through XLA. All that imports JAX is here.

The ways in are `backend` and `pure`; `runs` has the loops that JAX traces, diffrax's methods, and derivatives. It
imports `codegen` and what stands above, and is imported when the backend is asked for.
"""
