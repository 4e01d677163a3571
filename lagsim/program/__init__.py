"""The functions and kernels of a plan, compiled and linked with a method."""
