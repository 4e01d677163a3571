"""`lagsim stability`: where each method holds and where it fails."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lagsim.cli._faults import faults_shown
from lagsim.cli._shared import (
    AsJson,
    ModelPath,
    Picture,
    PictureForm,
    Quiet,
    Sets,
    aligned,
    assignments,
    coloured,
    counted,
    output_folder,
    show_json,
    table,
)
from lagsim.cli._writing import Measured, experiment
from lagsim.errors import InputError, Problem
from lagsim.methods import method_problems
from lagsim.model.reader import read_file
from lagsim.run.session import StartError, open_case, wanted
from lagsim.studies.bench import stability
from lagsim.studies.bench.stability import Wish, fastest_period

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.cli._writing import Experiment
    from lagsim.model.model import Model
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.session import Case
    from lagsim.studies.bench.stability import Border, Stability


def command(
    model: ModelPath,
    folder: Annotated[
        Path | None, output_folder("Output folder; default results/NAME/stability.")
    ] = None,
    sets: Sets = None,
    methods: Annotated[
        str | None,
        typer.Option(metavar="A,B", help="Only these methods; default all that apply."),
    ] = None,
    steps: Annotated[
        str | None,
        typer.Option(
            metavar="A:B",
            help="Range of steps; default around the predicted stability limits.",
        ),
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=A:B",
            help="Vary a parameter: maps over it and the step; for methods that choose "
            "their steps, their work.",
        ),
    ] = None,
    form: PictureForm = Picture.PNG,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> int:
    """Map where each method is stable and where it fails."""
    documents: list[Any] = []
    with faults_shown(documents if as_json else None, file=model) as code:
        wish = _wish(methods, steps, vary)
        measure, usual = _measured(model, assignments(sets), wish, form.value)
        code.append(
            experiment(
                "stability", measure, folder or usual, "stability.json", documents,
                quiet=quiet, as_json=as_json,
            )
        )  # fmt: skip
    if as_json and documents:
        show_json(documents[0])
    return code[0]


def _measured(
    path: str, overrides: Mapping[str, str], wish: Wish, form: str
) -> tuple[Experiment, Path]:
    """Give what measures a model, and where that goes by default.

    Raises
    ------
    InputError, StartError
    """
    model = read_file(path, overrides)
    settings = wanted(model, "stability")
    name = wish.name
    _check_parameter(model, name)
    usual = open_case(model, settings)
    stability.methods_for(usual, wish)

    def case(value: float | None) -> Case:
        if value is None:
            return usual
        assert name is not None
        try:
            return usual.bind({name: value})
        except StartError:
            problem = Problem("inadmissible", "the start is not admissible")
            raise InputError([problem]) from None

    def measured(interrupt: Interrupt, progress: Any) -> Measured:
        found = stability.measure(case, wish, interrupt=interrupt, progress=progress)

        def draw() -> bytes:
            from lagsim.studies.bench.stability_chart import chart

            return chart(model.name, found, name, form)

        picture = f"stability.{form}"
        files = [stability.TABLE, picture, stability.MANIFEST]
        return Measured(
            stability.document(found, wish, files),
            {stability.TABLE: stability.table(found.cells, name)},
            picture, draw, partial(_summary, model, found, name),
        )  # fmt: skip

    return measured, Path("results") / model.name / "stability"


def _check_parameter(model: Model, name: str | None) -> None:
    known = [p.name for p in model.parameters]
    if name is None or name in known:
        return
    text = f"--vary {name}: the model has no such parameter"
    hint = f"of {', '.join(known)}" if known else "it has no parameters"
    raise InputError([Problem("unknown-parameter", text, hint=hint)])


def _wish(methods: str | None, steps: str | None, vary: list[str] | None) -> Wish:
    """Take the options apart.

    Raises
    ------
    InputError
    """
    problems: list[Problem] = []
    wanted = None
    if methods is not None:
        wanted = tuple(dict.fromkeys(name.strip() for name in methods.split(",")))
        for wish in wanted:
            problems += method_problems(wish, auto=False)
    between = None if steps is None else _range("--steps", steps, problems)
    if between is not None and min(between) <= 0.0:
        problems.append(Problem("usage", f"--steps {steps}: steps are above 0"))
    name: str | None = None
    values = None
    if vary:
        if vary[1:]:
            text = "--vary is given more than once: one parameter varies at a time"
            problems.append(Problem("usage", text))
        name, _, after = vary[0].partition("=")
        name = name.strip()
        values = _range(f"--vary {name}", after, problems, "--vary K=10:1000")
    if problems:
        raise InputError(problems)
    return Wish(wanted, between, name, values)


def _range(
    option: str, text: str, problems: list[Problem], example: str = "--steps 0.01:1"
) -> tuple[float, float] | None:
    """Take A:B apart: two different numbers, the smaller first."""
    try:
        first, last = (float(part) for part in text.split(":"))
    except ValueError:
        first = last = math.nan
    if not (math.isfinite(first) and math.isfinite(last) and first != last):
        message = f"{option} {text}: two different numbers are expected"
        problems.append(Problem("usage", message, hint=f"such as {example}"))
        return None
    return min(first, last), max(first, last)


def _summary(model: Model, found: Stability, varied: str | None, files: str) -> str:
    """Give the closing lines."""
    state, colour = ("interrupted", "31") if found.interrupted else ("done", "32")
    count = len(found.methods) + len(found.adaptive)
    head = (
        f"{coloured(state, colour)}: {model.name}, {counted(count, 'method')}, "
        f"{counted(len(found.cells), 'run')}"
    )
    lines = [head]
    if varied is None:
        lines += _borders(found)
    else:
        lines += _over_parameter(found, varied)
    left_out: dict[str, list[str]] = {}
    for refused in found.refused:
        left_out.setdefault(refused.reason, []).append(refused.method)
    texts = [f"{', '.join(names)}: {reason}" for reason, names in left_out.items()]
    rows = [("" if k else "left out", text) for k, text in enumerate(texts)]
    rows += _eigenvalues(found)
    lines.append(table(rows))
    lines += [*_modes(found), table([("files", files)])]
    return "\n".join(line for line in lines if line)


def _aligned(rows: list[tuple[str, ...]]) -> list[str]:
    """Give rows in columns, all of which stand to the left."""
    return aligned(rows, lefts=len(rows[0])).splitlines()


def _borders(found: Stability) -> list[str]:
    """Give the borders of each method, in h and in the fastest period."""
    if not found.borders:
        return []
    period = fastest_period(found.subject)
    rows: list[tuple[str, ...]] = [
        ("method", "holds below (s)", "of the fastest period", "predicted (s)", "")
    ]
    for border in found.borders:
        step = border.found
        part = "" if step is None or not period else f"{step / period:.3g}"
        shown = "-" if step is None else f"{step:.3g}"
        rows.append((border.method, shown, part, _predicted(border), border.note))
    return _aligned(rows)


def _predicted(border: Border) -> str:
    """Give the predictions: one where both are alike."""
    ways = (border.at_start, border.along)
    first, second = (
        "none" if x is None else "every step grows" if x == 0.0 else f"{x:.3g}"
        for x in ways
    )
    return first if first == second else f"{first} at the start, {second} on the way"


def _over_parameter(found: Stability, varied: str) -> list[str]:
    """Give the borders at the ends of the parameter's range, and the work."""
    values = [value for value in found.values if value is not None]
    ends = (values[0], values[-1])
    rows: list[tuple[str, ...]] = []
    if found.methods:
        rows.append(("method", *(f"holds below (s), {varied} = {v:.4g}" for v in ends)))
    for name in found.methods:
        at = {b.value: b.found for b in found.borders if b.method == name}
        steps = (at.get(v) for v in ends)
        rows.append((name, *("-" if s is None else f"{s:.3g}" for s in steps)))
    if found.adaptive:
        rows.append(
            ("", *(f"evaluations, rejections, {varied} = {v:.4g}" for v in ends))
        )
    for name in found.adaptive:
        cells = {cell.value: cell for cell in found.of(name)}
        texts = []
        for v in ends:
            cell = cells.get(v)
            known = cell is not None and cell.evaluations is not None
            texts.append(
                f"{cell.evaluations}, {cell.rejections}" if cell and known else "-"
            )
        rows.append((name, *texts))
    return _aligned(rows)


def _eigenvalues(found: Stability) -> list[tuple[str, str]]:
    """Give them in short: fastest, slowest, damping."""
    subject = found.subject
    if subject.unknown:
        return [("eigenvalues", f"none: {subject.unknown}")]
    texts = []
    for where, values in (("start", subject.at_start), ("motion", subject.along)):
        known = values[abs(values) * subject.span > 1e-3]
        if not len(known):
            texts.append(f"{where}: all are 0")
            continue
        fastest, slowest = known[abs(known).argmax()], known[abs(known).argmin()]
        damping = -known.real / abs(known)
        low, high = _number(min(damping)), _number(max(damping))
        ends = dict.fromkeys((_complex(slowest), _complex(fastest)))
        ratios = dict.fromkeys((low, high))
        texts.append(
            f"{where}: {' to '.join(ends)} 1/s, damping ratio {' to '.join(ratios)}"
        )
    return [("" if k else "eigenvalues", text) for k, text in enumerate(texts)]


def _number(value: float) -> str:
    """Give three digits; what is only rounding beside 1 as 0."""
    return f"{value:.3g}" if abs(value) > 1e-9 else "0"


def _complex(value: complex) -> str:
    """Give one of a pair."""
    if abs(value.imag) <= 1e-9 * abs(value):
        return f"{value.real:.4g}"
    if abs(value.real) <= 1e-9 * abs(value):
        return f"±{abs(value.imag):.4g}i"
    return f"{value.real:.4g} ± {abs(value.imag):.4g}i"


def _modes(found: Stability) -> list[str]:
    """Give the equilibrium and the modes about it."""
    rest = found.rest
    if rest.at is None:
        lines = [table([("equilibrium", f"none: {rest.reason}")])]
    else:
        sizes = (*map(abs, rest.at.values()), *abs(found.subject.case.start.q))
        rounding = 1e-10 * max(sizes, default=0.0)
        at = [
            f"{name} = {x if abs(x) > rounding else 0.0:.6g}"
            for name, x in rest.at.items()
        ]
        if len(at) > 8:
            at = [*at[:8], f"... {len(at) - 8} more"]
        where = "the start" if rest.is_start else ", ".join(at)
        lines = [table([("equilibrium", where)])]
    if not rest.modes:
        return lines
    names = found.subject.equations.q
    rows: list[tuple[str, ...]] = [
        ("frequency (Hz)", "period (s)", "damping ratio", "shape")
    ]
    for mode in rest.modes:
        period = "-" if mode.period is None else f"{mode.period:.5g}"
        shapes = zip(names, mode.shape.real, strict=True)
        shape = [f"{name} {_number(x)}" for name, x in shapes]
        if len(shape) > 6:
            shape = [*shape[:6], "..."]
        ratio = _number(mode.damping_ratio)
        rows.append((f"{mode.frequency:.5g}", period, ratio, ", ".join(shape)))
    return lines + _aligned(rows)
