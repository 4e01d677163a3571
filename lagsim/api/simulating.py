"""Running a model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from lagsim.api.results import Result

if TYPE_CHECKING:
    from pathlib import Path

    from lagsim.api.models import Model


def simulate(
    model: Model | str | Path,
    *,
    duration: float | str | None = None,
    output_step: float | str | None = None,
    method: str | None = None,
    rtol: float | str | None = None,
    atol: float | str | None = None,
    step: float | str | None = None,
    formulation: str | None = None,
    gain: float | str | None = None,
    spectral_radius: float | str | None = None,
    error_bar: Literal["auto", "always", "never"] = "auto",
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
    spectral_radius
        Of the method `"generalized-alpha"`, from 0 to 1: what a step leaves of infinite
        frequencies.
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
    from lagsim.api.examining import Examination, InadmissibleError
    from lagsim.api.models import model_of
    from lagsim.api.words import given, in_python, one_of
    from lagsim.outputs.examined import document
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.observers import Keep
    from lagsim.run.session import Clock, StartError, open_case, wanted
    from lagsim.studies.attempts import Attempts, ErrorBars

    options = given(
        duration=duration, output_step=output_step, method=method, rtol=rtol, atol=atol,
        step=step, formulation=formulation, gain=gain, spectral_radius=spectral_radius,
    )  # fmt: skip
    bars = ErrorBars(one_of("error_bar", error_bar, [x.value for x in ErrorBars]))
    clock, keep = Clock(), Keep()
    with in_python():
        read = model_of(model)
        settings = wanted(read, "simulate", options, hint="add it, or give `duration`")
        clock.lap("read")
        try:
            session = open_case(read, settings, clock=clock).ready(clock=clock)
        except StartError as error:
            found = Examination(document(error.equations, error.examined))
            raise InadmissibleError(str(error), found) from None
    attempts = Attempts(keep, Interrupt(), clock, error_bars=bars, cornered=True)
    made = attempts.best(session)
    return Result(made, keep.table, clock.timings)
