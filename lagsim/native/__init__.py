"""Native code: kernels and equations as LLVM IR, object code kept and linked."""
