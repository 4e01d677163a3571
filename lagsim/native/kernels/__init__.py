"""Kernels in a small subset of Python -> LLVM IR."""
