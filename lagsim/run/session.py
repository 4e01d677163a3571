"""The way of a model to its rows: read, derive, examine, plan, compile, integrate.

A `Case` is what to simulate, and how; a `Session` one that is planned and compiled, and
runs as often as it is asked to. Whatever runs models goes this way: commands, studies,
and the Python interface. What is heavy to import is imported at its stage.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, NamedTuple

from lagsim.errors import InputError, LagsimError, Problem
from lagsim.run.interrupt import MOST_STEPS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lagsim.admissibility.examination import Start, StartReport
    from lagsim.mechanics.equations import Equations, Instant
    from lagsim.model.model import Model, Settings
    from lagsim.notes import Choice
    from lagsim.plan.plan import Plan
    from lagsim.program.functions import Columns
    from lagsim.program.system import System
    from lagsim.run.arc import Arc
    from lagsim.run.arcs import Apart, Run
    from lagsim.run.events.sections import Sections
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.observers import Corners, Observer
    from lagsim.run.trajectory import Trajectory

LAPS = (
    "import", "read", "derive", "compile", "integrate", "error_bar", "output", "plots",
)  # fmt: skip


class Clock:
    """Time in seconds that each stage has taken."""

    def __init__(self) -> None:
        self.timings = dict.fromkeys(LAPS, 0.0)
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """Record the time since the last lap."""
        now = time.perf_counter()
        self.timings[name] += now - self._last
        self._last = now

    def rounded(self) -> dict[str, float]:
        """Return them as documents do, to microseconds."""
        return {name: round(seconds, 6) for name, seconds in self.timings.items()}


class StartError(LagsimError):
    """No run begins at this start (exit 1); `examined` says why.

    Attributes
    ----------
    equations : Equations
    examined : StartReport
    """

    exit_code = 1
    code = "inadmissible"

    def __init__(self, equations: Equations, examined: StartReport) -> None:
        super().__init__()
        self.equations, self.examined = equations, examined

    def __str__(self) -> str:
        missed = [v.name for v in self.examined.verdicts if not v.satisfied]
        text = f"the start of {self.equations.model.name} is not admissible"
        return f"{text}: {', '.join(missed)}" if missed else text


class Case(NamedTuple):
    """Case of a simulation: equations, start, settings."""

    equations: Equations
    examined: StartReport
    settings: Settings

    @property
    def start(self) -> Start:
        """Start of the run."""
        return self.examined.start

    @property
    def model(self) -> Model:
        """Model that the equations are those of."""
        return self.equations.model

    def bind(self, parameters: Mapping[str, float | str]) -> Case:
        """Case with other values of parameters, derived no more.

        Raises
        ------
        InputError, StartError
        """
        model = self.equations.model.bind(parameters)
        return examined(self.equations, model, model.settings())

    def asking(self, **other: Any) -> Case:
        """Case with other settings."""
        return self._replace(settings=self.settings._replace(**other))

    def at(self, state: Instant) -> Case:
        """Case with another start, as admissible as its own."""
        return self._replace(examined=self.examined._replace(state=state))

    def plan(self) -> Plan:
        """Choose how to integrate.

        Raises
        ------
        InputError
            Where what was asked for cannot handle the model.
        """
        from lagsim.plan.plan import make_plan

        found = make_plan(self.equations, self.start, self.settings)
        self.equations.graph.unbind()
        return found

    def ready(self, plan: Plan | None = None, *, clock: Clock | None = None) -> Session:
        """Plan, unless there is a plan, and compile.

        Raises
        ------
        InputError
        """
        from lagsim.program.system import System

        clock = clock or Clock()
        clock.lap("import")
        plan = plan or self.plan()
        clock.lap("derive")
        session = Session(self, plan, System(self.equations, plan))
        session.system.link(plan.method)
        clock.lap("compile")
        return session


class Session(NamedTuple):
    """A case, planned and compiled.

    Attributes
    ----------
    longest_step : float
        No step of a method that chooses its steps is longer, if it is not 0; the ranges
        of the coordinates over the steps are then noted, too.
    arc_steps : float
        How many of the most steps an arc counts as, besides its own.
    """

    case: Case
    plan: Plan
    system: System
    longest_step: float = 0.0
    most_steps: int = MOST_STEPS
    arc_steps: float = 0.0

    @property
    def equations(self) -> Equations:
        """Equations of the case."""
        return self.case.equations

    @property
    def columns(self) -> Columns:
        """Columns of the rows."""
        return self.system.columns

    @property
    def lists_events(self) -> bool:
        """Whether constraints hold at times, forces have switches, or events act."""
        e = self.case.equations
        return bool(e.laws or self.plan.switches.sides or e.model.events)

    def bound(self, case: Case) -> Session | None:
        """Session of the same equations with other values, compiled no more.

        None where these values need other functions.
        """
        pieces = (
            [x.row.residual for x in e.laws] for e in (case.equations, self.equations)
        )
        if len({tuple(x) for x in pieces}) > 1:  # of gaps, by the signs of parameters
            return None
        plan = case.plan()
        if not self.system.fits(plan):
            return None
        system = self.system.bound(case.equations.model, plan)
        return self._replace(case=case, plan=plan, system=system)

    def by(self, plan: Plan) -> Session:
        """Return the same system integrated otherwise: at other tolerances, say."""
        return self._replace(plan=plan)

    def asking(self, **other: Any) -> Session:
        """Return the same with settings that change neither plan nor system."""
        return self._replace(case=self.case.asking(**other))

    def first_arc(self) -> Arc:
        """State at the start, on no way yet."""
        from lagsim.run.arc import first_arc

        case = self.case
        return first_arc(
            case.equations, case.start, self.plan, self.system, case.settings,
            self.longest_step,
        )  # fmt: skip

    def run(
        self,
        observers: Sequence[Observer],
        *,
        interrupt: Interrupt | None = None,
        progress: Callable[[float], None] | None = None,
        corners: Corners | None = None,
        sections: Sections | None = None,
        joined: Callable[[Run | Apart], None] | None = None,
    ) -> Trajectory:
        """Integrate, handing every row to the observers.

        Parameters
        ----------
        corners
            Gets what happens at events between rows.
        sections
            Gets the rows of sections.
        progress
            Called with the fraction of the run that is done.
        joined
            Gets the run before it begins, and may put it where another was.
        """
        from lagsim.run.arcs import Apart, Run

        run: Run | Apart
        first = self.first_arc()
        keywords: dict[str, Any] = {"interrupt": interrupt, "progress": progress}
        if self.plan.parts:
            run = Apart(first, observers, **keywords)
        else:
            run = Run(first, observers, corners=corners, sections=sections, **keywords)
        if joined is not None:
            joined(run)
        import numpy as np

        # A motion that diverges passes every number; what is made of it says so itself.
        with np.errstate(all="ignore"):
            return run.whole(self.most_steps, self.arc_steps)


def open_case(
    model: Model, settings: Settings | None = None, clock: Clock | None = None
) -> Case:
    """Derive the equations of a model and examine its start.

    Parameters
    ----------
    settings
        By default those of the file.

    Raises
    ------
    InputError, StartError
    """
    from lagsim.mechanics.reduction import equations_of_motion

    clock = clock or Clock()
    clock.lap("import")
    equations = equations_of_motion(model)
    clock.lap("derive")
    return _examined(equations, settings or model.settings(), clock)


def _examined(equations: Equations, settings: Settings, clock: Clock) -> Case:
    clock.lap("import")
    equations, examined = _begun(equations, settings)
    clock.lap("derive")
    if not examined.admissible:
        raise StartError(equations, examined)
    return Case(equations, examined, settings)


def _begun(
    equations: Equations, settings: Settings, *, classify: bool = False
) -> tuple[Equations, StartReport]:
    """Examine a start, with the modes that periodic events set there."""
    from lagsim.admissibility.examination import examine

    time, rest = settings.start, settings.rest
    report = examine(equations, time, rest=rest, classify=classify)
    begun = equations.begun(report.state) if equations.model.events else equations
    if begun is not equations:
        equations = begun
        report = examine(begun, time, rest=rest, classify=classify)
    return equations, report


def examined(equations: Equations, model: Model, settings: Settings) -> Case:
    """Case of equations with the values of another binding of their model.

    They are derived anew where a gap has other pieces with these values.

    Raises
    ------
    InputError, StartError
    """
    equations.graph.unbind()  # they were examined before
    if equations.has_pieces_of(model):
        return _examined(equations.of(model), settings, Clock())
    return open_case(model, settings)


def check(model: Model) -> tuple[Case, Sequence[Choice]]:
    """Look at a start, admissible or not, and at how it would be integrated.

    Raises
    ------
    InputError
    """
    from lagsim.mechanics.reduction import equations_of_motion

    settings = model.settings()
    if problems := [*unknown_names(settings), *too_frequent(model, settings)]:
        raise InputError(problems)
    equations, examined = _begun(equations_of_motion(model), settings, classify=True)
    case = Case(equations, examined, settings)
    choices = case.plan().choices if examined.admissible else ()
    equations.graph.unbind()
    return case, choices


def wanted(
    model: Model,
    who: str,
    options: Mapping[str, float | str] | None = None,
    hint: str = "add it",
) -> Settings:
    """Return the file's settings; refuse what this version cannot run.

    Parameters
    ----------
    who
        Who wants to run it, for messages.
    hint
        Where no duration is given.

    Raises
    ------
    InputError
    """
    settings = model.settings(options)
    if settings.duration:
        problems = [*unknown_names(settings), *too_frequent(model, settings)]
    else:
        text = f"{model.file}: `{who}` needs to know how long: there is no "
        text += "`simulation.duration` (or `end`)"
        problems = [Problem("missing-key", text, hint=hint)]
    if problems:
        raise InputError(problems)
    return settings


def too_frequent(model: Model, settings: Settings) -> list[Problem]:
    """Faults of periods that are too short for the run."""
    from lagsim.run.events.sections import too_many_strobes

    return [
        *too_many_strobes(model, settings),
        *_too_frequent_events(model, settings),
    ]


def _too_frequent_events(model: Model, settings: Settings) -> list[Problem]:
    return [
        Problem(
            "out-of-range",
            f"the event `{x.name}`, every {x.every:g}, would act more than "
            f"{MOST_STEPS:,} times in {settings.duration:g}",
            x.place,
        )
        for x in model.events
        if x.at is None and not settings.duration / x.every <= MOST_STEPS
    ]


def unknown_names(settings: Settings) -> list[Problem]:
    """Faults of a method, and a formulation, that do not exist."""
    from lagsim.methods import method_problems
    from lagsim.plan.formulation import formulation_problems

    return [
        *method_problems(settings.method, settings.method_place),
        *formulation_problems(settings.formulation, settings.formulation_place),
    ]
