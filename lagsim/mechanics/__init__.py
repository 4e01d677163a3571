"""Mechanics on the graph: equations, constraints, switches, reductions."""
