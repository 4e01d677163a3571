"""LLVM IR -> object code, kept by content, linked into callables."""
