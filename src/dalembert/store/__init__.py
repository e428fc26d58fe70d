"""Sweeps that are computed in parts and kept in a store, which a later call completes.

The way in is `sweep`. It imports `runs` and what stands above.
"""
