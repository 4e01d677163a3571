"""Graph -> LLVM IR: straight-line code, or tapes for functions too long to compile."""
