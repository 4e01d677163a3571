"""Sweep of a model over all combinations of values of parameters and of its start.

`runs` is the grid, and makes rows in pieces that any process can do, `sweeping`
has them made and keeps them on the way, takes points that are no grid, and `chart`
shows them.
"""
