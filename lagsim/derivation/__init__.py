"""Equations that people read: what `lagsim derive` prints, one file per format.

sympy is loaded by this room alone, and not for the format `python`, which is written
straight from the graph.

    equations -> translation (sympy) -> content, tidied -> text, latex, json
    equations -> python
"""
