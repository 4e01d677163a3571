"""The run: a plan's equations compiled, linked with a method, integrated arc by arc.

`session` hands every row to the observers; `arcs` is the loop, `arc` what one of them
is, `apart` runs subsystems. `system` is what is compiled. What pauses or ends arcs is a
source, and gives a decision (`decisions`) that the loop acts on; `recorder` keeps what
is said. Of the sources `events` has what happens on the way: breaks in `times`;
`switching`, the mode of each arc, with `shares` where it is on surfaces, and `sequence`
for those that come ever faster; `ranks`, losses of rank. `stiffness` and `fallback` go
on by other methods. `reasons` puts an outcome in words.
"""
