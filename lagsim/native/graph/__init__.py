"""Graph -> LLVM IR: straight-line code, or a tape for what is too long for that."""
