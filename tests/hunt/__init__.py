"""A hunt for silent wrong answers: random scenes, each against a referee of its own.

`grammar` makes smooth scenes, `truth` integrates their equations (`mechanics`, by sympy
from the texts) in long double, `verdict` compares. `contacts` and `features` make
scenes that are written twice, for lagsim and for the referee; `hybrid` integrates these
from event to event, `hybrid_verdict` compares. `instants` makes models of nested
switches, tables, limits, events and sections as `trees`; `flights` and `instants_run`
follow them by Taylor `series` from instant to instant, `instants_verdict` compares.
`fixed_steps` runs scenes of the last three by methods with fixed steps. Only
`lagsim_runs` uses lagsim, as a command.
"""
