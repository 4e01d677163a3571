"""The run: compiled equations of a plan, linked with a method, integrated arc by arc.

`session` prepares a run and passes its rows to the observers; `arcs` contains the loop
over arcs, and `arc` defines one arc. A source pauses or ends arcs and returns a
decision, which the loop carries out. The package `events`
contains the sources of events: `times` for breaks and pulses; `switching` for the modes
of switching surfaces in each arc, and `accumulation` of events; `contacts`;
`constraints` for impacts and losses of rank. `failures` changes the method where a
method fails or the motion is stiff, and states the reason of an outcome in words.
"""
