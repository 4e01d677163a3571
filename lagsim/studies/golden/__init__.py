"""Golden files: what a model's motion is, and how well that is known.

`motion` runs a model as a golden needs it, `invariants` are what stays when the motion
is no longer known, `measuring` finds the bounds, `storing` keeps all in two files, and
`judging` holds a run against them.
"""
