"""Native code: kernels and equations as LLVM IR; cache and linking of object code."""
