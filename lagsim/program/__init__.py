"""The functions and kernels of a plan, compiled and linked with a method.

Kernels have the arguments t, y, p and out: the time, the state (size,), the parameters
with the working memory (`methods.parts.parameters`), and the array of results. Shapes:
n is the number of coordinates, m that of constraint rows with those of laws.
"""
