"""Examining a start, and integrating a model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from lagsim.api.arguments import given, in_python, one_of, with_settings
from lagsim.api.models import model_of
from lagsim.api.results import Result
from lagsim.errors import LagsimError
from lagsim.outputs.examined import document
from lagsim.outputs.notebook import counted, heading, table
from lagsim.run import session
from lagsim.run.interrupt import Interrupt
from lagsim.run.observers import Keep
from lagsim.run.session import Clock, StartError, open_case, wanted
from lagsim.studies.attempts import Attempts, ErrorBars

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from typing import Unpack

    from lagsim.api.arguments import Options
    from lagsim.api.models import Model


class Examination:
    """The examination of a start: the keys of `check --json` are attributes.

    Attributes
    ----------
    record : dict
        All of them.
    """

    admissible: bool
    degrees_of_freedom: int
    repair: dict[str, float] | None

    def __init__(self, record: Mapping[str, Any]) -> None:
        self.record = dict(record)

    def __getattr__(self, name: str) -> Any:
        record: dict[str, Any] = self.__dict__.get("record", {})
        if name not in record:
            raise AttributeError(f"an examination has no entry `{name}`")
        return record[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.record]

    def __repr__(self) -> str:
        return f"<Examination of {self.record['model']['name']}: {self._verdict()}>"

    def _verdict(self) -> str:
        word = "admissible" if self.admissible else "not admissible"
        return f"{word}, {counted(self.degrees_of_freedom, 'degree of freedom')}"

    def _repr_html_(self) -> str:
        parts = [heading(f"{self.record['model']['name']}: {self._verdict()}")]
        rows = [
            (c["name"], c["mode"] or c["kind"], f"{c['residual']:.3g}",
             "yes" if c["satisfied"] else "no")
            for c in self.record["constraints"]
        ]  # fmt: skip
        if rows:
            parts.append(table(rows, ("constraint", "kind", "residual", "satisfied")))
        if self.repair:
            values = [(name, f"{x!r}") for name, x in self.repair.items()]
            parts.append(table(values, ("the nearest start", "")))
        notes = [(w["code"], w["text"]) for w in self.record["warnings"]]
        parts += [table(notes, ("warning", ""))] if notes else []
        return "\n".join(parts)


class InadmissibleError(LagsimError):
    """No run begins at this start; `examination` says why, and what would do."""

    exit_code = 1
    code = "inadmissible"

    def __init__(self, text: str, examination: Examination) -> None:
        super().__init__(text)
        self.examination = examination


def check(model: Model | str | Path) -> Examination:
    """Return whether the start of a model is admissible, and what its constraints are.

    Parameters
    ----------
    model
        What `load` gives, a path, or the text of a model file.

    Raises
    ------
    InputError
        Where the model has faults, or asks for a method or a formulation that cannot be
        had.
    """
    case, choices = session.check(model_of(model))
    return Examination(document(case.equations, case.examined, choices))


@with_settings
def simulate(
    model: Model | str | Path,
    *,
    error_bar: Literal["auto", "always", "never"] = "auto",
    **options: Unpack[Options],
) -> Result:
    """Integrate a model. Options replace the keys of the model's `simulation`.

    Numbers may be expressions of the model's parameters: `duration="2*pi/w"`.

    Parameters
    ----------
    model
        What `load` gives, a path, or the text of a model file.
    duration
        How long the run lasts, in the model's unit of time.
    output_step
        The time between two rows; a thousandth of the duration where nobody says so.
        Steps do not depend on it where the method chooses them.
    method
        The integrator: `"auto"`, or one of `lagsim methods`.
    rtol
        The relative tolerance of a step, for methods that choose their steps.
    atol
        The absolute tolerance, in the unit of each coordinate; by default each has its
        own, `rtol` times the size of its motion.
    step
        The step of methods with a fixed step; `output_step` by default.
    formulation
        How constraints are met: `"auto"`, or a name in docs/model-file.md.
    gain
        Of the formulation `"baumgarte"`: the rate, per unit of time, at which what is
        off the constraints decays.
    error_bar
        When the run is repeated with a smaller tolerance to estimate its error:
        `"auto"`, where that takes no more than about 2 s.

    Raises
    ------
    InputError
        Where the model has faults, or something asked for cannot be had.
    InadmissibleError
        Where the start is not admissible.
    """
    asked = given(options)
    bars = ErrorBars(one_of("error_bar", error_bar, [x.value for x in ErrorBars]))
    clock, keep = Clock(), Keep()
    with in_python():
        read = model_of(model)
        settings = wanted(read, "simulate", asked, hint="add it, or give `duration`")
        clock.lap("read")
        try:
            session = open_case(read, settings, clock=clock).ready(clock=clock)
        except StartError as error:
            found = Examination(document(error.equations, error.examined))
            raise InadmissibleError(str(error), found) from None
    attempts = Attempts(keep, Interrupt(), clock, error_bars=bars, cornered=True)
    made = attempts.best(session)
    return Result(made, keep.table, clock.timings)
