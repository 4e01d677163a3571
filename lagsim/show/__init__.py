"""Equations that people read: what `lagsim derive` prints.

sympy is loaded by this room alone, and not for the format `python`, which is written
straight from the graph.

    equations -> lagrange (graph, then sympy) -> content, tidy -> text, latex, as_json
    equations -> as_python
"""
