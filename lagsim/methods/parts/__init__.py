"""Parts of integration methods: tableaus, step control, projection, the loop.

Kernels have the arguments s, the memory of the method with the state y, and p, the
parameters with the working memory of the model (`parameters`). h is the length of a
step, x in [0, 1] a fraction of the last step, t a time. Shapes: size is the number of
components of y, n that of coordinates, C that of conditions, R that of the rows of the
search table.
"""
