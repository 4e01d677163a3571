"""E9xx: lagsim itself, and the machine below it."""

from __future__ import annotations

from lagsim.codes.row import Row

ROWS = (
    Row(
        "E901", "bug",
        "lagsim handles every input without an internal error.",
        "this is a bug in lagsim, not in your model: please report it with the model "
        "file and what is printed",
        commands=(),
        found="lagsim has failed by an error of its own.",
    ),
    Row(
        "E902", "failed",
        "Each process that does a part of the work ends normally.",
        "run the named model by itself, to see its messages",
        commands=(),
        found="A process ended before it had a result.",
    ),
    Row(
        "E903", "starved",
        "The system has enough memory and open files.",
        "raise the limits (ulimit -v, ulimit -n, those of a container), or run less at "
        "one time",
        commands=(),
        found="The system has no memory or no open files left.",
    ),
    Row(
        "E904", "unknown-cpu",
        "`LAGSIM_CPU` names a processor that LLVM knows.",
        "leave it out",
        commands=("LAGSIM_CPU=abacus lagsim run pendulum.yaml --no-plots",),
        found="`LAGSIM_CPU` names an unknown processor.",
    ),
)  # fmt: skip
