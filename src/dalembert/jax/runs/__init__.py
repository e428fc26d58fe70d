"""Runs in JAX: a loop whose lanes are the cases, diffrax's methods for single trajectories, derivatives along records.

The way in is `runs`. It imports the packages above `codegen`.
"""
