"""A hunt for silent wrong answers: random scenes, each against a referee of its own.

`grammar` makes scenes, `mechanics` derives their equations by sympy from the texts,
`integrator` and `truth` integrate these in long double, `lagsim_runs` runs lagsim in
a process that may crash or hang, `verdict` compares the two. Nothing but
`lagsim_runs` knows lagsim, and that only as a command.

`features` makes scenes of families, frames, tables, states, modes and events, each in
lagsim's words and written out; `hybrid` integrates these, and scenes of `contacts`,
from event to event.
"""
