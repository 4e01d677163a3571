"""One model at many values of parameters and of its start: all combinations of them.

`grid` is what is swept, `runs` makes the rows, in pieces that any process can do,
`journal` keeps them on the way, `sweeping` has them made and `document` and `chart`
show them.
"""
