"""C99 of kernels and of the loops that call them, for exports; imports nothing that runs compiled code."""
