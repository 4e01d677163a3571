"""E7xx: files and folders that are written."""

from __future__ import annotations

from lagsim.codes.row import Row

ROWS = (
    Row(
        "E701", "output-folder",
        "The output folder can be made and written, and nothing else writes into it.",
        "choose another folder",
        commands=("lagsim run pendulum.yaml -o pendulum.yaml",),
    ),
    Row(
        "E702", "output-file",
        "The output file can be written, and is not the model.",
        "choose another file",
        commands=("lagsim derive pendulum.yaml -o pendulum.yaml",),
    ),
    Row(
        "E703", "exists",
        "`lagsim new` writes where there is nothing yet.",
        "choose another name",
        commands=("lagsim new pendulum",),
    ),
    Row(
        "E704", "unwritable",
        "The model file can be written.",
        "look at the folder, and at who may write there",
        commands=("lagsim new nowhere/pendulum",),
    ),
    Row(
        "E705", "no-room",
        "What was computed has a place to go.",
        "make room on the disk, or choose another one with -o",
        commands=("lagsim methods > /dev/full",),
    ),
    Row(
        "E706", "missing-package",
        "What an option needs is installed.",
        "install what the message names, or leave the option out",
        commands=(),
    ),
    Row(
        "E707", "one-name",
        "Models that are run together have names of their own, and so folders.",
        "give one of them another `name`",
        commands=(
            "cp pendulum.yaml twin.yaml",
            "lagsim run pendulum.yaml twin.yaml --no-plots",
        ),
    ),
)  # fmt: skip
