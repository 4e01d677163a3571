"""The run: a plan's equations compiled, linked with a method, integrated arc by arc.

`session` hands every row to the observers; `arcs` is the loop, also that of subsystems,
`arc` what one of them is. `system` is what is compiled. What pauses or ends arcs is a
source, and gives a decision that the loop acts on. Of the sources `events` has what
happens on the way: breaks and pulses in `times`; `switching`, the mode of each arc,
and `sequence` for switches that come ever faster; `contacts`; impacts and losses of
rank in `constraints`. `failures` goes on by another method where one fails or a
motion is stiff, or puts an outcome in words.
"""
