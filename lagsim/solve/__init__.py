"""Solving for q'' and lambda: `straight` on the graph, `dense` in loops."""
