"""Sweep of a model over all combinations of values of parameters and start values.

`runs` has the grid, and makes rows in pieces that any process can compute. `sweeping`
distributes the pieces, stores rows on the way, and reads points that are no grid.
`chart` draws the results.
"""
