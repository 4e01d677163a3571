"""Sweep of a model over all combinations of values of parameters and start values.

`grid` has the values, and the rows of the sweep; `runs` makes rows in pieces that any
process can compute, `batches` many rows at a time. `sweeping` distributes the
pieces, stores rows on the way, and reads points that are no grid. `chart` draws the
results.
"""
