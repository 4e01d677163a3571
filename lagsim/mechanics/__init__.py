"""What is derived on the graph: equations, constraints, switches, reductions."""
