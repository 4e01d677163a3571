"""Mechanics on the graph: equations, constraints, switches, reductions.

A node is the integer of an expression in the graph. Shapes: n is the number of
coordinates, m that of constraint rows, l that of first-order states, r that of the rows
of a contact problem.
"""
