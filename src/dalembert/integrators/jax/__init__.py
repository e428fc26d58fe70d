"""Integration in loops that JAX traces, and by diffrax."""
