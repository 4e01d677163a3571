"""E7xx: files and folders that are written."""

from __future__ import annotations

from lagsim.codes.row import Row

ROWS = (
    Row(
        "E701", "output-folder",
        "The output folder can be made and written, and nothing else writes into it.",
        "choose another folder",
        commands=("lagsim run pendulum.yaml -o pendulum.yaml",),
        found="The output folder cannot be used.",
    ),
    Row(
        "E702", "output-file",
        "The output file can be written, and is not the model.",
        "choose another file",
        commands=("lagsim derive pendulum.yaml -o pendulum.yaml",),
        found="The output file cannot be written.",
    ),
    Row(
        "E703", "exists",
        "`lagsim new` writes where there is nothing yet.",
        "choose another name",
        commands=("lagsim new pendulum",),
        found="The file exists already.",
    ),
    Row(
        "E704", "unwritable",
        "The model file can be written.",
        "look at the folder, and at who may write there",
        commands=("lagsim new nowhere/pendulum",),
        found="The model file cannot be written.",
    ),
    Row(
        "E705", "no-room",
        "The results can be written.",
        "make room on the disk, or choose another one with -o",
        commands=("lagsim methods > /dev/full",),
        found="There is no room for the results.",
    ),
    Row(
        "E706", "missing-package",
        "The packages that an option needs are installed.",
        "install what the message names, or leave the option out",
        commands=(),
        found="A package that an option needs is not installed.",
    ),
    Row(
        "E707", "one-name",
        "Models that are run together have different names, and so different folders.",
        "give one of them another `name`",
        commands=(
            "cp pendulum.yaml twin.yaml",
            "lagsim run pendulum.yaml twin.yaml --no-plots",
        ),
        found="Two models have the same name.",
    ),
)  # fmt: skip
