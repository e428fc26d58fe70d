"""The LLVM backend: kernels as assembly, compiled by llvmlite, and the calls of compiled loops."""
