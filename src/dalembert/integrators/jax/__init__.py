"""Integration by diffrax, for kernels that JAX traces."""
