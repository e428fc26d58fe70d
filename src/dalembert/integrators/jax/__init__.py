"""Integration in loops that JAX traces."""
