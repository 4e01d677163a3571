"""The stages from a model to its rows: read, derive, examine, plan, compile, integrate.

A `Case` consists of equations, start and settings; a `Session` is a planned and
compiled case, which can be run any number of times. Commands, studies and the Python
interface all run models by sessions. Large modules are imported only at their stage.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, NamedTuple

from lagsim.codes.known import INADMISSIBLE, MISSING_KEY, OUT_OF_RANGE, RETIRED
from lagsim.errors import InputError, LagsimError, Problem
from lagsim.notes import Caution
from lagsim.run.interrupt import MOST_STEPS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from lagsim.admissibility.examination import Start, StartReport
    from lagsim.mechanics.equations import Equations, Instant
    from lagsim.model.model import Model, Settings
    from lagsim.notes import Choice
    from lagsim.plan.plan import Plan
    from lagsim.program.output_row import Columns
    from lagsim.program.system import System
    from lagsim.run.arc import Arc
    from lagsim.run.arcs import Run
    from lagsim.run.event_store import EventList
    from lagsim.run.events.sections import Sections
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.observers import Corners, Observer
    from lagsim.run.trajectory import Trajectory

LAPS = (
    "import", "read", "derive", "compile", "integrate", "error_bar", "output", "plots",
)  # fmt: skip


class Stopwatch:
    """Elapsed time of each stage in seconds."""

    def __init__(self) -> None:
        self.timings = dict.fromkeys(LAPS, 0.0)
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """Add the time since the last lap to the stage `name`."""
        now = time.perf_counter()
        self.timings[name] += now - self._last
        self._last = now

    def rounded(self) -> dict[str, float]:
        """Return the elapsed times, rounded to microseconds for documents."""
        return {name: round(seconds, 6) for name, seconds in self.timings.items()}


class StartError(LagsimError):
    """Error raised for an inadmissible start (exit code 1).

    Attributes
    ----------
    equations : Equations
        Equations of the model whose start is inadmissible.
    examined : StartReport
        Verdicts on the start, with the reasons.
    """

    exit_code = 1
    code = INADMISSIBLE

    def __init__(self, equations: Equations, examined: StartReport) -> None:
        super().__init__()
        self.equations, self.examined = equations, examined

    def __str__(self) -> str:
        missed = [v.name for v in self.examined.verdicts if not v.satisfied]
        text = f"the start of {self.equations.model.name} is not admissible"
        return f"{text}: {', '.join(missed)}" if missed else text


class Case(NamedTuple):
    """Case of a simulation: equations, an admissible start, and settings.

    Attributes
    ----------
    equations : Equations
        Complete equations of motion.
    examined : StartReport
        The start, with the verdicts on its relations.
    settings : Settings
        Settings of the simulation.
    """

    equations: Equations
    examined: StartReport
    settings: Settings

    @property
    def start(self) -> Start:
        """Start of the run."""
        return self.examined.start

    @property
    def model(self) -> Model:
        """Model of the equations."""
        return self.equations.model

    def bind(self, parameters: Mapping[str, float | str]) -> Case:
        """Return the case with other values of parameters.

        The equations are derived anew only if the pieces of a gap change.

        parameters : name -> value.

        Raises
        ------
        InputError, StartError
        """
        model = self.equations.model.bind(parameters)
        return examined(self.equations, model, model.settings())

    def with_settings(self, **other: Any) -> Case:
        """Return the case with some settings replaced."""
        return self._replace(settings=self.settings._replace(**other))

    def at(self, state: Instant) -> Case:
        """Return the case with the start `state`, which is not examined again."""
        return self._replace(examined=self.examined._replace(state=state))

    def plan(self) -> Plan:
        """Choose the formulation, the linear solver and the method.

        Raises
        ------
        InputError
            If the requested method or formulation cannot handle the model.
        """
        from lagsim.plan.plan import make_plan

        found = make_plan(self.equations, self.start, self.settings)
        self.equations.graph.unbind()
        return found

    def ready(
        self,
        plan: Plan | None = None,
        *,
        clock: Stopwatch | None = None,
        quick: bool = False,
    ) -> Session:
        """Compile the case by `plan`, by default by its own plan.

        clock : receives the time of each stage.
        quick : whether kernels are first linked as quick code, for a single run.

        Raises
        ------
        InputError
            If the requested method or formulation cannot handle the model.
        """
        from lagsim.program.system import System

        clock = clock or Stopwatch()
        clock.lap("import")
        plan = plan or self.plan()
        clock.lap("derive")
        session = Session(self, plan, System(self.equations, plan, quick=quick))
        session.system.link(plan.method)
        clock.lap("compile")
        return session


class Session(NamedTuple):
    """A planned and compiled case.

    Attributes
    ----------
    case : Case
        Equations, start and settings.
    plan : Plan
        Formulation, solution and method.
    system : System
        Compiled functions of the plan.
    longest_step : float
        Largest step of a method with adaptive steps; 0 for no limit. With a limit, the
        ranges of the coordinates over the steps are recorded, too.
    most_steps : int
        Largest number of steps of a run.
    arc_steps : float
        Number of steps that each arc counts as, in addition to its own steps.
    """

    case: Case
    plan: Plan
    system: System
    longest_step: float = 0.0
    most_steps: int = MOST_STEPS
    arc_steps: float = 0.0

    @property
    def equations(self) -> Equations:
        """Equations of motion of the case."""
        return self.case.equations

    @property
    def columns(self) -> Columns:
        """Columns of the output rows."""
        return self.system.columns

    @property
    def lists_events(self) -> bool:
        """Whether there are unilateral constraints, switches or events of the file."""
        e = self.case.equations
        return bool(e.laws or self.plan.switches.sides or e.model.events)

    def bound(self, case: Case, plan: Plan | None = None) -> Session | None:
        """Return a session of `case` with the compiled functions of this session.

        None if the values require other functions.

        Parameters
        ----------
        case : Case
            A case of the same equations, with other values or settings.
        plan : Plan, optional
            The plan of the case.
        """
        pieces = (
            [x.row.residual for x in e.laws] for e in (case.equations, self.equations)
        )
        # pieces of gaps depend on the signs of parameters
        if len({tuple(x) for x in pieces}) > 1:
            return None
        plan = plan or case.plan()
        if not self.system.fits(plan):
            return None
        system = self.system.bound(case.equations.model, plan)
        return self._replace(case=case, plan=plan, system=system)

    def by(self, plan: Plan) -> Session:
        """Return the session with another plan, such as one with other tolerances.

        The plan must need no functions besides the compiled ones.
        """
        return self._replace(plan=plan)

    def with_settings(self, **other: Any) -> Session:
        """Return the session with settings replaced that affect no plan or system."""
        return self._replace(case=self.case.with_settings(**other))

    def first_arc(self) -> Arc:
        """Return the first arc, at the start of the run."""
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
        listed: EventList | None = None,
        joined: Callable[[Run], None] | None = None,
    ) -> Trajectory:
        """Integrate the case and pass every row to the observers.

        Parameters
        ----------
        observers
            Receive the rows in blocks (k, columns).
        interrupt
            Requests of an early end.
        progress
            Called with the fraction of the run that is done.
        corners
            Receives the rows just before and just after events.
        sections
            Receives the rows of sections.
        listed
            Receives all events in the order of time; by default they are kept in
            memory.
        joined
            Called with the run before its start; may restore the state of another run.
        """
        from lagsim.run.arcs import Run

        run = Run(
            self.first_arc(), observers, interrupt=interrupt, progress=progress,
            corners=corners, sections=sections, listed=listed,
        )  # fmt: skip
        if joined is not None:
            joined(run)
        import numpy as np

        # A diverging motion overflows; the run checks its values and reports it.
        with np.errstate(all="ignore"):
            return run.whole(self.most_steps, self.arc_steps)


def open_case(
    model: Model, settings: Settings | None = None, clock: Stopwatch | None = None
) -> Case:
    """Derive the equations of a model and examine its start.

    Parameters
    ----------
    settings
        Settings of the simulation, by default the file's.
    clock
        Receives the time of each stage.

    Raises
    ------
    InputError, StartError
    """
    from lagsim.mechanics.reduction import equations_of_motion

    clock, settings = clock or Stopwatch(), settings or model.settings()
    clock.lap("import")
    equations = equations_of_motion(suited(model, settings), gathers=True)
    clock.lap("derive")
    return _examined(equations, settings, clock)


def suited(model: Model, settings: Settings) -> Model:
    """Return a model whose elements, if any, the method of a run can integrate.

    The result is the model, or the model with all elements written out, see
    `language.elements`.

    settings : the settings of the run, with its method.

    Raises
    ------
    InputError
        If the method cannot integrate so many terms written out.
    """
    from lagsim.mechanics.derivation import may_gather
    from lagsim.methods import method
    from lagsim.plan.method_choice import ANY, refuse_elements

    name = ANY if settings.method == "auto" else settings.method
    known = not unknown_names(settings)
    if known and may_gather(model, method(name).NEEDS):
        return model
    if known:
        refuse_elements(model, settings)
    return model.written_out()


def _examined(equations: Equations, settings: Settings, clock: Stopwatch) -> Case:
    clock.lap("import")
    equations, examined = after_start_events(equations, settings)
    clock.lap("derive")
    if not examined.admissible:
        raise StartError(equations, examined)
    return Case(equations, examined, settings)


def after_start_events(
    equations: Equations, settings: Settings, *, classify: bool = False
) -> tuple[Equations, StartReport]:
    """Return the equations with the modes set by events at the start, and the report.

    The report is that on the start with these modes.

    classify : passed to `examine`.
    equations : the equations with the modes of the file before the events.
    settings : the settings of the run.
    """
    from lagsim.admissibility.examination import examine
    from lagsim.mechanics.forces import lost_impulses
    from lagsim.run.events.rounds import after_acts_at_start

    if problems := lost_impulses(equations):
        raise InputError(problems)
    time, rest = settings.start, settings.rest
    report = examine(equations, time, rest=rest, classify=classify)
    begun = equations
    if equations.model.events:
        begun = after_acts_at_start(equations, report.state)
    if begun is not equations:
        equations = begun
        report = examine(begun, time, rest=rest, classify=classify)
    return equations, report._replace(warnings=(*report.warnings, *_retired(settings)))


def _retired(settings: Settings) -> Iterator[Caution]:
    for key, name in settings.retired:
        place = settings.method_place if key == "method" else settings.formulation_place
        text = f"the {key} `{name}` is retired: `auto` takes its place"
        yield Caution(RETIRED, text, place)


def examined(equations: Equations, model: Model, settings: Settings) -> Case:
    """Return the case of derived equations with the parameter values of `model`.

    The equations are derived anew if the values change the pieces of a gap, or if
    `model` was read anew and so has another graph.

    Parameters
    ----------
    equations
        Equations of the same model with other parameter values.

    Raises
    ------
    InputError, StartError
    """
    equations.graph.unbind()  # the nodes were examined before
    if model.graph is equations.graph and equations.has_pieces_of(model):
        return _examined(equations.of(model), settings, Stopwatch())
    return open_case(model, settings)


def check(model: Model) -> tuple[Case, Sequence[Choice]]:
    """Return the case of a model, and the choices of its plan.

    The start need not be admissible; if it is not, there are no choices.

    Raises
    ------
    InputError
    """
    from lagsim.mechanics.reduction import equations_of_motion

    settings = model.settings()
    if problems := [*unknown_names(settings), *too_frequent(model, settings)]:
        raise InputError(problems)
    equations = equations_of_motion(suited(model, settings), gathers=True)
    equations, examined = after_start_events(equations, settings, classify=True)
    case = Case(equations, examined, settings)
    choices = case.plan().choices if examined.admissible else ()
    equations.graph.unbind()
    return case, choices


def settings_of(
    model: Model,
    caller: str,
    options: Mapping[str, float | str] | None = None,
    hint: str = "add it",
) -> Settings:
    """Return the settings of the file, with `options`, for a simulation.

    Parameters
    ----------
    caller
        Name of the command or function that runs the model, for messages.
    options
        Settings that replace the settings of the file.
    hint
        Advice if the file has no duration.

    Raises
    ------
    InputError
        If the duration is missing, a method or formulation does not exist, or events
        are too frequent.
    """
    settings = model.settings(options)
    if settings.duration:
        problems = [*unknown_names(settings), *too_frequent(model, settings)]
    else:
        text = f"{model.file}: `{caller}` needs a duration: there is no "
        text += "`simulation.duration` (or `end`)"
        problems = [Problem(MISSING_KEY, text, hint=hint)]
    if problems:
        raise InputError(problems)
    return settings


def too_frequent(model: Model, settings: Settings) -> list[Problem]:
    """Return problems with periods of strobes and events too short for the run.

    model, settings : the events and strobes, and the duration of the run.
    """
    from lagsim.run.events.sections import too_many_strobes

    return [
        *too_many_strobes(model, settings),
        *_too_frequent_events(model, settings),
    ]


def _too_frequent_events(model: Model, settings: Settings) -> list[Problem]:
    return [
        Problem(
            OUT_OF_RANGE,
            f"the event `{x.name}`, every {x.every:g}, would act more than "
            f"{MOST_STEPS:,} times in {settings.duration:g}",
            x.place,
        )
        for x in model.events
        if x.at is None and not settings.duration / x.every <= MOST_STEPS
    ]


def unknown_names(settings: Settings) -> list[Problem]:
    """Return problems with a method and a formulation that do not exist.

    The list is empty if both exist.

    settings : the settings of the run.
    """
    from lagsim.methods import method_problems
    from lagsim.plan.formulation import formulation_problems

    return [
        *method_problems(settings.method, settings.method_place),
        *formulation_problems(settings.formulation, settings.formulation_place),
    ]
