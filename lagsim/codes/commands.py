"""E8xx: the command line."""

from __future__ import annotations

from lagsim.codes.row import Row

ROWS = (
    Row(
        "E801", "usage",
        "A command gets the arguments and options that it takes.",
        "`lagsim COMMAND --help` lists them",
        commands=("lagsim check pendulum.yaml --set m",),
        found="An argument or an option is wrong.",
    ),
    Row(
        "E802", "unknown-template",
        "A template is one of those that `lagsim new --help` lists.",
        "`lagsim new --help` lists them",
        commands=("lagsim new swing --template swing",),
        found="The template does not exist.",
    ),
    Row(
        "E803", "unknown-code",
        "A message has a number such as E104, and a code such as duplicate-key.",
        "docs/errors.md lists them all, and so does `lagsim explain`",
        commands=("lagsim explain E999",),
        found="There is no message of this number or code.",
    ),
)  # fmt: skip
