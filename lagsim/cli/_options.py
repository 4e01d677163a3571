"""The options of commands that run models: how to integrate."""

from __future__ import annotations

from typing import Annotated

import typer

from lagsim.methods import names
from lagsim.model.settings import DEFAULT_ROWS, DEFAULT_RTOL, ROWS_TO_DECAY
from lagsim.studies.attempts import ErrorBars

Method = Annotated[
    str | None,
    typer.Option(
        metavar="M",
        help="Integration method; see `lagsim methods`.",
        autocompletion=lambda: ["auto", *names()],
    ),
]
Rtol = Annotated[
    str | None,
    typer.Option(metavar="X", help=f"Relative tolerance; default {DEFAULT_RTOL:g}."),
]
Atol = Annotated[
    str | None,
    typer.Option(
        metavar="X",
        help="Absolute tolerance; default rtol times each component's scale.",
    ),
]
Step = Annotated[
    str | None,
    typer.Option(
        metavar="H", help="Step of fixed-step methods; default the output step."
    ),
]
Formulation = Annotated[
    str | None,
    typer.Option(
        metavar="F",
        help="How constraints are met: projection, elimination, baumgarte, drift; "
        "full: nothing is reduced.",
    ),
]
Gain = Annotated[
    str | None,
    typer.Option(
        metavar="X",
        help="Of baumgarte, per unit of time; "
        f"default {1 / ROWS_TO_DECAY:g}/output step.",
    ),
]
SpectralRadius = Annotated[
    str | None,
    typer.Option(metavar="X", help="Of generalized-alpha, from 0 to 1."),
]
Duration = Annotated[str | None, typer.Option(metavar="T", help="How long to run.")]
OutputStep = Annotated[
    str | None,
    typer.Option(
        metavar="H", help=f"Spacing of rows; default duration/{DEFAULT_ROWS}."
    ),
]
ErrorBar = Annotated[
    ErrorBars,
    typer.Option(
        help="Repeat the run more tightly to estimate its error; auto: where that "
        "takes no more than about 2 s."
    ),
]


def given(**options: str | None) -> dict[str, str]:
    """Give the options that have been given, by the keys of `simulation`."""
    return {name: text for name, text in options.items() if text is not None}
