"""Many runs of one scene, LANES of them at once, each with steps of its own.

A step as most are is tried and taken, or tried anew, in all lanes at once, by the
kernels of the method that `native.kernels.wide` has made of its text. A lane in which
anything else is to be done (a state that is not finite, a row that is asked for, an
end) is handed to `advance` as it was before. So each run has the bits that it has
alone. One that comes to anything but its end is left, with what `advance` gave, to be
made alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.state import BLOCK_FULL, PAUSED, State
from lagsim.native.kernels.lines import LANES
from lagsim.native.kernels.words import at, external
from lagsim.native.layout import Memory, array

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# Words of the header of a state.
T = State.fields["t"].word
END = State.fields["end"].word
STEPS = State.fields["steps"].word
NOBODY = -1.0
# Rows that a lane which is handed on may write at a time: nobody sees them.
ROWS = 64


class Ensemble(Memory):
    """Runs, and the lanes that they are made in."""

    runs: int
    size: int  # components of y
    words: int  # of the state of a run
    room: int  # of its parameters, and working memory
    columns: int  # of a row
    begin: int  # where in a state its y begins
    which: int  # ... which of its two series is the present one ...
    plain: int  # ... whether a step is made in lanes ...
    first: int  # ... and the two series themselves, each so long
    length: int

    next: float  # the run that is to begin next
    working: float  # lanes that have a run
    most: float  # steps of a run that is no longer one of many
    shared: float  # which series is the present one, in all lanes

    # LANES runs, interleaved: their states and parameters. Lines of the cache.
    lanes: Floats = array(lambda e: LANES * e.words)
    memory: Floats = array(lambda e: LANES * e.room)
    who: Floats = array(lambda _: LANES, NOBODY)  # the run of each lane
    codes: Floats = array(lambda e: e.runs, NOBODY)  # what each run came to
    states: Floats = array(lambda e: e.runs * e.words)
    parameters: Floats = array(lambda e: e.runs * e.room)
    begun: Floats = array(lambda e: e.runs * e.columns)  # the row of each start ...
    ended: Floats = array(lambda e: e.runs * e.columns)  # ... and of each end
    rows: Floats = array(lambda e: ROWS * (1 + e.size))
    work: Floats = array(lambda e: LANES * (1 + e.size + e.columns))


@external
def prepare(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Compute what depends on parameters alone."""


@external
def advance(s: Floats, p: Floats, out: Floats, rows: int, budget: int) -> int:
    """See `driver.advance`."""
    raise NotImplementedError


@external
def tabulate(
    states: Floats,
    rows: int,
    size: int,
    p: Floats,
    out: Floats,
    width: int,
    work: Floats,
) -> None:
    """See `driver.tabulate`."""


@external
def try_plain(s: Floats, p: Floats) -> None:
    """Try a step in all lanes."""


@external
def take_plain(s: Floats, p: Floats) -> None:
    """Take it where it is accepted."""


def together(e: Ensemble, budget: int) -> int:
    """Go on with the runs by so many steps of all lanes; tell how many lanes work."""
    who = e.who
    lanes = e.lanes
    if e.next == 0.0:
        for lane in range(LANES):
            load(e, 0, lane)
        for lane in range(LANES):
            begin_next(e, lane)
    made = 0
    while e.working > 0.0 and made < budget:
        made += 1
        try_plain(lanes, e.memory)
        for lane in range(LANES):
            run = int(who[lane])
            if run >= 0 and lanes[e.plain * LANES + lane] == 0.0:
                save(e, run, lane)
        take_plain(lanes, e.memory)
        e.shared = 1.0 - e.shared
        for lane in range(LANES):
            run = int(who[lane])
            if run >= 0:
                go_on(e, run, lane)
    return int(e.working)


def go_on(e: Ensemble, run: int, lane: int) -> None:
    """Do what is to be done in a lane after a step of all of them."""
    lanes = e.lanes
    codes = e.codes
    code = PAUSED
    over = lanes[T * LANES + lane] >= lanes[END * LANES + lane]
    if lanes[e.plain * LANES + lane] == 0.0:
        code = alone(e, run, 1)
        if code == PAUSED:
            load_state(e, run, lane)
    elif over:
        save(e, run, lane)
        code = alone(e, run, 0)
    if code == PAUSED and lanes[STEPS * LANES + lane] < e.most:
        return
    codes[run] = float(code)
    show(e, run, e.ended)
    e.working -= 1.0
    begin_next(e, lane)


def alone(e: Ensemble, run: int, budget: int) -> int:
    """Go on with a run by itself; give its code."""
    state = at(e.states, run * e.words)
    own = at(e.parameters, run * e.room)
    code = advance(state, own, e.rows, ROWS, budget)
    while code == BLOCK_FULL:
        code = advance(state, own, e.rows, ROWS, 0)
    return code


def begin_next(e: Ensemble, lane: int) -> None:
    """Begin the next run in a lane, if there is one."""
    who = e.who
    codes = e.codes
    who[lane] = NOBODY
    while who[lane] == NOBODY and e.next < e.runs:
        run = int(e.next)
        e.next += 1.0
        own = at(e.parameters, run * e.room)
        prepare(0.0, own, own, own)
        show(e, run, e.begun)
        code = alone(e, run, 0)
        codes[run] = float(code)
        if code == PAUSED:
            who[lane] = float(run)
            e.working += 1.0
            load(e, run, lane)


def show(e: Ensemble, run: int, out: Floats) -> None:
    """Give the row (columns,) of the state that a run has reached."""
    state = at(e.states, run * e.words)
    row = e.rows
    row[0] = state[T]
    for i in range(e.size):
        row[1 + i] = state[e.begin + i]
    own = at(e.parameters, run * e.room)
    tabulate(row, 1, e.size, own, at(out, run * e.columns), e.columns, e.work)


def load(e: Ensemble, run: int, lane: int) -> None:
    """Put a run into a lane."""
    own = at(e.parameters, run * e.room)
    memory = e.memory
    for k in range(e.room):
        memory[k * LANES + lane] = own[k]
    load_state(e, run, lane)


def load_state(e: Ensemble, run: int, lane: int) -> None:
    """Put the state of a run into a lane; its present series where that of all is."""
    state = at(e.states, run * e.words)
    lanes = at(e.lanes, lane)
    first = e.first
    length = e.length
    for k in range(e.words):
        lanes[k * LANES] = state[k]
    if state[e.which] != e.shared:
        lanes[e.which * LANES] = e.shared
        for k in range(length):
            lanes[(first + k) * LANES] = state[first + length + k]
            lanes[(first + length + k) * LANES] = state[first + k]


def save(e: Ensemble, run: int, lane: int) -> None:
    """Take the state of a run out of a lane."""
    state = at(e.states, run * e.words)
    lanes = at(e.lanes, lane)
    for k in range(e.words):
        state[k] = lanes[k * LANES]
