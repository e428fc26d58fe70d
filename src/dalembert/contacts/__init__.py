"""Contacts and friction: the hybrid automaton, equations and decisions about its modes, the loop over phases.

The ways in are `automaton`, `contact_decisions` and `phase_loop`. It imports `loops` and what stands above.
"""
