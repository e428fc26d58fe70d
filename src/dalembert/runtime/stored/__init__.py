"""Sweeps that are computed in parts and kept in a store, which a later call completes."""
