"""The intermediate representation: expression graph, kernels, programs, verifier and interpreter."""
