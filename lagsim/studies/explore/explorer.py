"""Motions of a model file at any values of its parameters and of its start.

The model is read and derived once, its functions are compiled once (see
`lagsim.studies.trials`), and each motion binds new values. When the file has changed it
is read again. Faults of the file or of the values are texts, as the commands print
them.
"""

from __future__ import annotations

import hashlib
import math
import pickle
import struct
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from lagsim.admissibility.point import Point
from lagsim.codes.known import FAILED, UNKNOWN_NAME, USAGE
from lagsim.errors import (
    InputError,
    LagsimError,
    Problem,
    Problems,
    did_you_mean,
    unusable,
)
from lagsim.model.model import Level
from lagsim.model.reader import read_file
from lagsim.outputs.animation import film, film_of_energies, frames_of, record, stage
from lagsim.outputs.letters import raised_powers
from lagsim.outputs.manifest import encode
from lagsim.outputs.units import units
from lagsim.run.interrupt import Interrupt
from lagsim.run.observers.thinning import Frames
from lagsim.run.session import StartError
from lagsim.run.trajectory import Outcome
from lagsim.studies.explore.dragging import ConstrainedStart
from lagsim.studies.rest import full_turn_angles
from lagsim.studies.trial import tried
from lagsim.studies.trials import Forms

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lagsim.codes.known import ErrorCode
    from lagsim.language.arrays import Floats
    from lagsim.model.model import Model, Parameter
    from lagsim.run.session import Session

    Values = Mapping[str, float | str]
    Document = dict[str, Any]

WHO = "explore"
# Rows of a motion that a page receives: a screen has no more columns of pixels.
MOST_ROWS = 2048
# A slider of a parameter covers this multiple of its value, of a start value this
# multiple of the extent of the motion about the start.
TIMES, ABOUT = 3.0, 2.0
# A start value that changes by less, relative to its size, is constant.
STILL = 1e-6
# Letters of an expression, and the hint where a value is none.
LONGEST = 1000
VALUES = f"values are expressions of at most {LONGEST} letters, such as 0.5 or pi/3"


class Slider(NamedTuple):
    """A value that the page changes.

    Attributes
    ----------
    name, unit, description : str
    value : float
        The value in the file.
    low, high : float
        The ends of the slider; nan for a start value until a motion is known.
    start : bool
        Whether the value is a start value, and not a parameter.
    whole : bool
        Whether the value is a number of members of families.
    fixed : str
        The reason why the file permits no other value, or "".
    """

    name: str
    value: float
    low: float
    high: float
    unit: str = ""
    description: str = ""
    start: bool = False
    whole: bool = False
    fixed: str = ""


class SupersededError(Exception):
    """Signal that a motion was interrupted, because a later one is requested."""


class Explorer:
    """Motions of one model file.

    Methods may be called by several threads; one computation runs at a time.

    Parameters
    ----------
    file : str or Model
        Path of the model file, or a model, whose file is not watched.
    overrides : mapping of str to str
        Values of `--set`.
    vary : mapping of str to (float, float) or None
        The names on the page with the ends of their sliders, if stated; all plain
        parameters and all start values if the mapping is empty.
    shown : callable
        Maps an error to its text, as a command prints it.

    Attributes
    ----------
    fault : str
        The fault of the present file, or "". The last sound model stays in use.
    version : int
        Number of sound models read so far.

    Raises
    ------
    LagsimError
        If the file has faults when the explorer is created, or a name is unknown.
    """

    def __init__(
        self,
        file: str | Model,
        overrides: Mapping[str, str],
        vary: Mapping[str, tuple[float, float] | None],
        shown: Callable[[LagsimError], str],
    ) -> None:
        self._overrides, self._vary = dict(overrides), dict(vary)
        self.file = file if isinstance(file, str) else ""
        model = read_file(file, self._overrides) if isinstance(file, str) else file
        self._shown = shown
        self._lock = threading.Lock()
        self._asked: dict[tuple[str, bool], Interrupt] = {}
        self.fault, self.version = "", 0
        self._use(model)
        # With the files of its tables, which are known now.
        self._stamps: dict[Path, tuple[int, int]] = {}
        self._digest = self._read()

    # --- The file

    def _use(self, model: Model) -> None:
        """Replace the model whose motions are computed by `model`."""
        sliders, content = _sliders(model, self._vary), pickle.dumps(model)
        self.model, self._content = model, content
        # The ranges for other numbers of members are found while the browser opens.
        limits = self._limits = _Limits(content, sliders)
        limits.start()
        self._forms = Forms(content, {}, WHO)
        self._around: dict[str, list[float]] = {}
        self.version += 1

    def files(self) -> list[Path]:
        """Return the paths of the model file and of the files of its tables."""
        if not self.file:
            return []
        tables = {t.file for t in self.model.tables if t.file}
        file = Path(self.file)
        return [file, *(file.parent / name for name in sorted(tables))]

    def _read(self) -> str:
        """Return a digest of all files; unreadable ones count as empty."""
        found = hashlib.sha256()
        for path in self.files():
            try:
                content = path.read_bytes()
            except OSError:
                content = b""
            found.update(b"%d\n" % len(content) + content)
        return found.hexdigest()

    def changed(self) -> bool:
        """Read the file again if the file, or a table of it, has been saved since.

        Returns
        -------
        bool
            Whether the content has changed; then `version` or `fault` is new.
        """
        stamps = {}
        for path in self.files():
            try:
                status = path.stat()
            except OSError:
                continue
            stamps[path] = status.st_mtime_ns, status.st_size
        if stamps == self._stamps:
            return False
        self._stamps = stamps
        digest = self._read()
        if digest == self._digest:
            return False
        self._digest = digest
        try:
            model = read_file(self.file, self._overrides)
            with self._lock:
                self._use(model)
            self.fault = ""
        except LagsimError as error:
            self.fault = self._shown(error)
        return True

    @property
    def document(self) -> Document:
        """The model, for the page: name, description, sliders, version, fault."""
        return {
            "name": self.model.name,
            "description": self.model.description,
            "sliders": [
                x._replace(unit=raised_powers(x.unit))._asdict()
                for x in self._limits.sliders()
            ],
            "version": self.version,
            "fault": self.fault,
        }

    def equations(self) -> str:
        """Return the equations of motion as MathML."""
        from lagsim.mechanics.derivation import derive, may_gather
        from lagsim.show import has_many_rows
        from lagsim.show.lagrange import derived
        from lagsim.show.mathml import as_mathml

        # A separate copy, since motions are computed meanwhile.
        model = pickle.loads(self._content)
        many, gathers = has_many_rows(model), may_gather(model)
        equations = derive(model, chained=many, gathers=gathers, trees=False)
        return as_mathml(derived(equations, matrices=False))

    def text(self, values: Values) -> str:
        """Return the text of the model file with other values, comments kept.

        Raises
        ------
        LagsimError
            If a value cannot be used, or the file has no place for it.
        """
        with self._lock:
            given = self._texts(values)
            bound = self.model.bind(**given)
            known = bound.parameter_values
            known |= {x.name: x.value for x in bound.initial}
            names = self._overrides | given
            return self.model.stated.rewritten({name: known[name] for name in names})

    # --- Motions

    def motion(self, values: Values, page: str, *, follow: bool = False) -> bytes:
        """Return the motion at some values, in the format of `packed`.

        Parameters
        ----------
        values : mapping of str to float or str
            Numbers and expressions that replace those of the file.
        page : str
            Text that identifies the page. A later call for that page ends this call.
        follow : bool
            Whether the start moves to the nearest admissible one, if the values make it
            inadmissible. The header has the values that moved under `moved`.

        Raises
        ------
        SupersededError
            If a later call has ended this call.
        LagsimError
            If a value cannot be used, or the start is not admissible.
        """
        with _Alone(self._lock, self._asked, page) as interrupt:
            session, changed = self._followed(values, follow=follow)
            names = session.columns.names
            shown = frames_of(session.equations, names).names
            table = names[: session.columns.table]
            wanted = tuple(dict.fromkeys((*table, *shown)))
            frames = Frames(names, wanted, MOST_ROWS)
            ended = tried(session, observer=frames, interrupt=interrupt).trajectory
            if interrupt.requested:
                raise SupersededError
            columns = dict(zip(wanted, frames.table.T, strict=True))
            about = units(session.equations, session.columns.of_table)
            made = film(session.equations, frames, ended.events, units=about)
            model = session.case.model
            header = {
                "version": self.version,
                "film": record(
                    made or film_of_energies(model.name, columns, ended.events)
                ),
                "columns": list(table),
                "units": {name: raised_powers(unit) for name, unit in about.items()},
                "state": self._state_names(session),
                "ends": self.ends(session, columns),
                "values": _values_of(session),
                "moved": {name: _digits(x) for name, x in changed.items()},
                "held": not ConstrainedStart(session.case).is_free,
                "error": self._ended(ended.outcome, ended.reason),
            }
            return packed(header, [columns[name] for name in table])

    def state(self, values: Values, t: float, page: str) -> dict[str, float]:
        """Return time, coordinates, rates and first-order states at a time of the run.

        Parameters
        ----------
        values
            See `motion`.
        t : float
            The time; outside of the run the nearest time of the run is used.
        page : str
            Text that identifies the page. A later call of `state` or `motion` for that
            page ends this call; this call ends earlier calls of `state`, but none of
            `motion`.

        Raises
        ------
        SupersededError
            If a later call has ended this call.
        LagsimError
            If a value cannot be used, or the run fails before t.
        """
        with _Alone(self._lock, self._asked, page, moves=False) as interrupt:
            session = self._session(values)
            settings = session.case.settings
            first, last = sorted((settings.start, settings.start + settings.duration))
            times = np.array([min(max(t, first), last)])
            found = tried(session, times, interrupt=interrupt)
            if interrupt.requested:
                raise SupersededError
            row = found.rows[0] if len(found.rows) else np.full(1, math.nan)
            if not math.isfinite(row[0]):
                if found.outcome == Outcome.UNTIL.word and found.end < t:
                    found = tried(session, np.array([found.end]))
                    row = found.rows[0]
                else:
                    raise _failure(found.code, found.reason)
            known = dict(zip(found.columns, row.tolist(), strict=True))
            return {name: known[name] for name in self._state_names(session)}

    def drag(
        self,
        values: Values,
        t: float,
        point: str,
        target: Sequence[float],
        page: str,
    ) -> dict[str, float]:
        """Return start values that put a point of the scene at a target, or near it.

        Parameters
        ----------
        values
            The values of the motion that the page shows, see `motion`.
        t : float
            Time of the configuration from which the point is dragged.
        point : str
            Name of a point of the scene.
        target : sequence of float
            The place of the point, (2,) or (3,).
        page : str
            See `state`.

        Raises
        ------
        SupersededError
        LagsimError
            If a value cannot be used.
        """
        state = self.state(values, t, page)
        with self._lock:
            session = self._session(values)
            start = ConstrainedStart(session.case)
            return start.dragged(state, point, np.array(target, float))

    def start(self, values: Values, name: str, value: float) -> dict[str, float]:
        """Return start values in which the start value `name` is `value`, or near it.

        The other start values change least such that the constraints hold; unchanged
        ones are left out. The value is missed where the constraints exclude it.

        Parameters
        ----------
        values
            The values of the motion that the page shows, see `motion`.
        name : str
            A start value. Only coordinates and velocities are subject to constraints;
            any other start value is returned alone.
        value : float

        Raises
        ------
        LagsimError
            If one of `values` cannot be used.
        """
        with self._lock:
            session = self._session(values)
            start, equations = ConstrainedStart(session.case), session.equations
            if start.is_free or name not in (*equations.q, *equations.velocities):
                return {name: value}
            before = _values_of(session)
            found = start.with_value(name, value)
            return {x: y for x, y in found.items() if y != before[x] or x == name}

    def _texts(self, values: Values) -> dict[str, str]:
        """Return values as texts of expressions, by name.

        Raises
        ------
        LagsimError
            If a value is empty, too long, or not finite.
        """
        found = {}
        for name, value in values.items():
            text = value if isinstance(value, str) else _digits(value)
            if len(text) > LONGEST or not text.strip():
                shown = f"{text[:20]}..." if text.strip() else "empty"
                about = f"the value of `{name}` is no expression: {shown}"
                raise unusable(USAGE, about, hint=VALUES)
            if not isinstance(value, str) and not math.isfinite(value):
                about = f"the value of `{name}` is {value}, not a finite number"
                raise unusable(USAGE, about, hint=VALUES)
            found[name] = text
        return found

    @property
    def session(self) -> Session:
        """The session with the values of the file."""
        return self._session({})

    @property
    def overridden(self) -> list[str]:
        """The names of parameters and start values that `--set` replaces."""
        return list(self._overrides)

    @property
    def varied(self) -> list[str]:
        """The names that `--vary` selects."""
        return list(self._vary)

    def _followed(
        self, values: Values, *, follow: bool
    ) -> tuple[Session, dict[str, float]]:
        """Return the session of some values, and the start values that were changed.

        If the start is inadmissible and `follow` is set, the nearest admissible start
        is used.
        """
        try:
            return self._session(values), {}
        except StartError as error:
            changed = error.examined.repair
            if not (follow and changed):
                raise
            return self._session({**values, **changed}), changed

    def _session(self, values: Values) -> Session:
        return self._forms.session(self._texts(values))

    def _state_names(self, session: Session) -> list[str]:
        return ["t", *session.equations.state]

    def ends(self, session: Session, columns: Mapping[str, Floats]) -> Document:
        """Return the ends of the sliders: by name, a list of two numbers.

        The ends of a start value follow from the motion with the values of the file, at
        the first call.

        session : the session of that motion.
        columns : its columns (rows,) by name.
        """
        if not self._around:
            angles = _angles(session)
            for x in self._limits.sliders():
                if math.isnan(x.low):
                    # A member that does not exist with these values has no motion.
                    values = columns.get(x.name, np.zeros(0))
                    ends = _around(x, values, angle=x.name in angles)
                else:
                    ends = x.low, x.high
                self._around[x.name] = [*ends]
        return self._around

    def _ended(self, outcome: Outcome, reason: str) -> str:
        """Return the text of a failed run by outcome and reason; "" if complete."""
        if outcome.complete:
            return ""
        code = str(outcome.value) if outcome.failed else ""
        return self._shown(_failure(code, reason))

    def error_text(self, error: LagsimError) -> str:
        """Return the text of an error, as a command prints it."""
        return self._shown(error)


class _Limits(threading.Thread):
    """Thread that finds the range of each slider for a number of members.

    The range consists of the numbers with which the file can be read. It is a single
    number where the file lists a value for each member of a family.

    Parameters
    ----------
    content : bytes
        The pickled Model.
    given : list of Slider
        All sliders, without the ends to be found.
    """

    def __init__(self, content: bytes, given: list[Slider]) -> None:
        super().__init__(daemon=True)
        self._content, self._given = content, given

    def sliders(self) -> list[Slider]:
        """Return the sliders, once all ends are known."""
        self.join()
        return self._given

    def run(self) -> None:
        """Find the ends of the sliders of whole numbers, in a thread."""
        # Names that are not families are directions or choices; there may be many.
        counts = {x.name for x in self._given if x.whole and "." not in x.name}
        if counts:
            model = pickle.loads(self._content)
            self._given = [
                _limited(model, x) if x.name in counts else x for x in self._given
            ]


def _limited(model: Model, x: Slider) -> Slider:
    """Return a slider for a number of members of families, with its ends.

    The ends are found by trial: within these the model can be read with each number.

    x : the slider without ends.
    """
    reason = ""

    def fits(value: int) -> bool:
        nonlocal reason
        try:
            model.bind(**{x.name: str(value)})
        except InputError as error:
            reason = reason or error.problems[0].text
            return False
        return True

    def last(end: int) -> int:
        way = 1 if end > value else -1
        if end == value or not fits(value + way):
            return value
        if fits(end):
            return end
        good, bad = value + way, end
        while abs(bad - good) > 1:
            middle = (good + bad) // 2
            good, bad = (middle, bad) if fits(middle) else (good, middle)
        return good

    value = int(x.value)
    low, high = last(math.ceil(x.low)), last(math.floor(x.high))
    return x._replace(low=low, high=high, fixed=reason if low == high else "")


class _Alone:
    """Context manager in which one computation of a page runs, without others.

    On entry it requests the end of earlier computations of the page: a motion ends the
    earlier motion and the earlier state, a state the earlier state alone. It yields the
    Interrupt by which a later computation ends this one.

    Parameters
    ----------
    lock : Lock
        The lock that is held within the context.
    requests : dict of (str, bool) to Interrupt
        The latest computation of each page, by the page and by whether it is a motion.
    page : str
        Text that identifies the page.
    moves : bool
        Whether the computation is a motion, and not a state.

    Raises
    ------
    SupersededError
        On entry, if a later computation has ended this one while it was waiting.
    """

    def __init__(
        self,
        lock: threading.Lock,
        requests: dict[tuple[str, bool], Interrupt],
        page: str,
        *,
        moves: bool = True,
    ) -> None:
        self._lock, self._asked, self._key = lock, requests, (page, moves)
        self._own = Interrupt()

    def __enter__(self) -> Interrupt:
        page, moves = self._key
        ended = [self._asked.get((page, False))]
        if moves:
            ended.append(self._asked.get((page, True)))
        self._asked[self._key] = self._own
        for before in ended:
            if before is not None:
                before.stop()
        self._lock.acquire()
        if self._own.requested:
            self._lock.release()
            raise SupersededError
        return self._own

    def __exit__(self, *_: object) -> None:
        if self._asked.get(self._key) is self._own:
            del self._asked[self._key]
        self._lock.release()


def packed(header: Document, columns: Sequence[Floats]) -> bytes:
    """Return a motion as bytes for the page: a header, then the columns of its rows.

    Layout, little-endian: the length of the header as uint32; the header in JSON, with
    spaces appended so that these two parts take a multiple of 8 bytes; then each column
    as float64. The number of rows is added to the header.
    """
    rows = len(columns[0])
    content = encode(header | {"rows": rows}).rstrip()
    content += b" " * (-(4 + len(content)) % 8)
    numbers = np.stack(columns).astype("<f8").tobytes()
    return struct.pack("<I", len(content)) + content + numbers


def _values_of(session: Session) -> dict[str, float]:
    """Return the values of parameters and the start, by name."""
    model, equations = session.case.model, session.equations
    start = session.case.start
    state = np.concatenate([start.q, start.v, start.s]).tolist()
    return model.parameter_values | dict(zip(equations.state, state, strict=True))


def _failure(code: str, reason: str) -> LagsimError:
    return InputError([Problem(cast("ErrorCode", code or FAILED), reason)])


def _sliders(
    model: Model, vary: Mapping[str, tuple[float, float] | None]
) -> list[Slider]:
    """Return the sliders of a model: for the names of `vary`, or for all numbers.

    Raises
    ------
    InputError
        If the model has no value of a name.
    """
    every = [
        _of_parameter(p) for p in model.parameters if vary or not (p.follows or p.mode)
    ]
    counts = model.stated.structural()
    every = [
        x._replace(low=min(max(x.low, 1.0), x.value), whole=True)
        if x.name in counts
        else x
        for x in every
    ]
    variables = {x.name: x for x in model.variables}
    every += [
        Slider(
            x.name, x.value, math.nan, math.nan,
            variables[x.name].unit if x.name in variables else "", start=True,
        )
        for x in model.initial
        if x.node is None
    ]  # fmt: skip
    if not vary:
        return every
    known, problems, found = {x.name: x for x in every}, Problems(), []
    for name, ends in vary.items():
        if name not in known:
            hint = did_you_mean(name, known) or f"one of {', '.join(known)}"
            text = f"there is no parameter or start value `{name}`"
            problems.add(UNKNOWN_NAME, text, hint=hint)
            continue
        x = known[name]
        if ends is not None:
            x = x._replace(low=ends[0], high=ends[1])
        found.append(x)
    problems.refuse()
    return found


def _of_parameter(p: Parameter) -> Slider:
    low, high = p.range or sorted((0.0, TIMES * p.value))
    if low == high:
        low, high = -1.0, 1.0
    return Slider(p.name, p.value, low, high, p.unit, p.description)


def _angles(session: Session) -> set[str]:
    """Return the names of coordinates that are angles of period 2 pi.

    These have the unit rad; or no unit, if points of the scene and definitions have
    that period, too.
    """
    e = session.equations
    model, point = session.case.model, Point(e, session.case.start)
    units = {c.name: c.unit for c in model.coordinates}
    shown_nodes = [x for place in stage(model).points.values() for x in place]
    shown_nodes += [d.node for d in model.definitions if d.level is Level.POSITION]
    found = set()
    for name, turns, shows in zip(
        e.q, full_turn_angles(point), full_turn_angles(point, shown_nodes), strict=True
    ):
        unit = units.get(name, "")
        if turns and (unit == "rad" or (shows and not unit)):
            found.add(name)
    return found


def _around(x: Slider, values: Floats, *, angle: bool) -> tuple[float, float]:
    """Return the ends of the slider `x` of a start value.

    Parameters
    ----------
    values : ndarray, shape (rows,)
        The values of the coordinate, or of its rate, in the motion from this start.
    angle : bool
        Whether the value is an angle of period 2 pi.
    """
    middle, reach = x.value, math.pi
    if angle:
        middle = 0.0 if abs(x.value) <= math.pi else x.value
    else:
        values = values[np.isfinite(values)]
        extent = float(np.ptp(values)) if len(values) else 0.0
        if extent <= STILL * abs(x.value):
            extent = 0.0
        reach = ABOUT / 2.0 * extent or abs(x.value) or 1.0
    return middle - reach, middle + reach


def _digits(value: float) -> str:
    """Return a number as text that reads back exactly; a whole one without a point."""
    return repr(float(value)).removesuffix(".0")
