"""Motions with contacts, phase after phase: one motion, many cases, prepared runs, and states in a mode.

The way in is `given_values`. It imports `runs`, `analysis` and what stands above.
"""
