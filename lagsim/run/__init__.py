"""The run: a plan's equations compiled, linked with a method, integrated arc by arc.

`simulate` hands every row to the observers; `arcs` is the loop, `apart` runs
subsystems. `system` is what is compiled. `events` finds what happens on the way:
`switching` the mode of each arc, with `shares` where it is on surfaces, and `sequence`
for those that come ever faster; `ranks` tells of losses of rank. `reasons` puts an
outcome in words.
"""
