"""LLVM IR -> object code, cached by its inputs, linked into callables."""
