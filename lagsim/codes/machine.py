"""E9xx: lagsim itself, and the machine below it."""

from __future__ import annotations

from lagsim.codes.row import Row

ROWS = (
    Row(
        "E901", "bug",
        "lagsim foresees what it is given.",
        "this is a bug in lagsim, not in your model: please report it with the model "
        "file and what is printed",
        commands=(),
    ),
    Row(
        "E902", "failed",
        "A process that does a part of the work ends by itself.",
        "run the model that is named alone, to see what it says",
        commands=(),
    ),
    Row(
        "E903", "starved",
        "The system has memory and open files to give.",
        "raise the limits (ulimit -v, ulimit -n, those of a container), or run less at "
        "one time",
        commands=(),
    ),
    Row(
        "E904", "unknown-cpu",
        "`LAGSIM_CPU` names a processor that LLVM knows.",
        "leave it out",
        commands=("LAGSIM_CPU=abacus lagsim run pendulum.yaml --no-plots",),
    ),
)  # fmt: skip
