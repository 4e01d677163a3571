"""A hunt for silent wrong answers: random scenes, each against a referee of its own.

`grammar` and `contacts` make scenes, `referee` derives their equations by sympy from
the texts and integrates these by scipy, `lagsim_runs` runs lagsim in a process that may
crash or hang, `verdict` compares the two, `hunting` makes what fails small. Nothing but
`lagsim_runs` knows lagsim, and that only as a command.
"""
