"""Analyses of runs and states: sensitivities, linearisations, equilibria, comparisons of formulations.

It imports `runs` and what stands above.
"""
