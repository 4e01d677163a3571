"""Many runs of one scene, LANES of them at once, each with steps of its own.

A step as most are is tried and taken in all lanes at once, by the kernels of the method
that `native.kernels.wide` has made of its text. A lane in which anything else is to be
done (a step that is not accepted, a look at rounding, a row that is asked for, an end)
is handed to `advance` as it was before. So each run has the bits that it has alone. One
that comes to anything but its end is left, with what `advance` gave, to be made alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.state import BLOCK_FULL, DONE, PAUSED, State
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


class Ensemble(Memory):
    """Runs and lanes."""

    runs: int
    words: int  # of the state of a run
    room: int  # of its parameters, and working memory
    which: int  # words of a state: which of its two series is the present one ...
    plain: int  # ... and whether a step can be taken at once
    first: int  # the series themselves, one after the other, each so long
    length: int
    rows: int  # that `rest` has room for

    next: float  # the run that is to begin next
    working: float  # lanes that have a run
    most: float  # steps of a run that is no longer one of many
    shared: float  # which series is the present one, in all lanes

    who: Floats = array(lambda _: LANES, NOBODY)  # the run of each lane
    codes: Floats = array(lambda e: e.runs)  # what each run came to


@external
def prepare(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Compute what depends on parameters alone."""


@external
def advance(s: Floats, p: Floats, out: Floats, rows: int, budget: int) -> int:
    """See `driver.advance`."""
    raise NotImplementedError


@external
def try_plain(s: Floats, p: Floats) -> None:
    """Try a step in all lanes."""


@external
def take_plain(s: Floats, p: Floats) -> None:
    """Take it."""


def together(
    e: Ensemble,
    states: Floats,
    parameters: Floats,
    lanes: Floats,
    memory: Floats,
    rest: Floats,
    budget: int,
) -> int:
    """Go on with the runs by so many steps of all lanes; tell how many lanes work.

    states : (runs, words), each at its start; parameters : (runs, room); lanes, memory:
    the same of LANES runs, interleaved; rest : (rows, 1 + size), for rows that nobody
    sees.
    """
    who = e.who
    if e.next == 0.0:
        for lane in range(LANES):
            load(e, states, parameters, lanes, memory, 0, lane)
        for lane in range(LANES):
            begin_next(e, states, parameters, lanes, memory, rest, lane)
    made = 0
    while e.working > 0.0 and made < budget:
        made += 1
        try_plain(lanes, memory)
        for lane in range(LANES):
            run = int(who[lane])
            if run >= 0 and lanes[e.plain * LANES + lane] == 0.0:
                save(e, states, lanes, run, lane)
        take_plain(lanes, memory)
        e.shared = 1.0 - e.shared
        for lane in range(LANES):
            run = int(who[lane])
            if run >= 0:
                go_on(e, states, parameters, lanes, memory, rest, run, lane)
    return int(e.working)


def go_on(
    e: Ensemble,
    states: Floats,
    parameters: Floats,
    lanes: Floats,
    memory: Floats,
    rest: Floats,
    run: int,
    lane: int,
) -> None:
    """Do what is to be done in a lane after a step of all of them."""
    code = PAUSED
    over = lanes[T * LANES + lane] >= lanes[END * LANES + lane]
    long = lanes[STEPS * LANES + lane] >= e.most
    state = at(states, run * e.words)
    own = at(parameters, run * e.room)
    if lanes[e.plain * LANES + lane] == 0.0:
        code = advance(state, own, rest, e.rows, 1)
        while code == BLOCK_FULL:
            code = advance(state, own, rest, e.rows, 0)
        if code == PAUSED:
            load_state(e, states, lanes, run, lane)
    elif over or long:
        save(e, states, lanes, run, lane)
        code = advance(state, own, rest, e.rows, 0)
        while code == BLOCK_FULL:
            code = advance(state, own, rest, e.rows, 0)
    if code != PAUSED or state[STEPS] >= e.most:
        e.codes[run] = float(code)
        e.working -= 1.0
        begin_next(e, states, parameters, lanes, memory, rest, lane)


def begin_next(
    e: Ensemble,
    states: Floats,
    parameters: Floats,
    lanes: Floats,
    memory: Floats,
    rest: Floats,
    lane: int,
) -> None:
    """Begin the next run in a lane, if there is one."""
    who = e.who
    codes = e.codes
    who[lane] = NOBODY
    while who[lane] == NOBODY and e.next < e.runs:
        run = int(e.next)
        e.next += 1.0
        own = at(parameters, run * e.room)
        prepare(0.0, own, own, own)
        code = advance(at(states, run * e.words), own, rest, e.rows, 0)
        codes[run] = float(code)
        if code == PAUSED:
            who[lane] = float(run)
            e.working += 1.0
            load(e, states, parameters, lanes, memory, run, lane)


def load(
    e: Ensemble,
    states: Floats,
    parameters: Floats,
    lanes: Floats,
    memory: Floats,
    run: int,
    lane: int,
) -> None:
    """Put a run into a lane."""
    own = at(parameters, run * e.room)
    for k in range(e.room):
        memory[k * LANES + lane] = own[k]
    load_state(e, states, lanes, run, lane)


def load_state(e: Ensemble, states: Floats, lanes: Floats, run: int, lane: int) -> None:
    """Put the state of a run into a lane; its present series where that of all is."""
    state = at(states, run * e.words)
    length = e.length
    for k in range(e.first):
        lanes[k * LANES + lane] = state[k]
    lanes[e.which * LANES + lane] = e.shared
    for k in range(e.first + 2 * length, e.words):
        lanes[k * LANES + lane] = state[k]
    apart = 0 if state[e.which] == e.shared else length
    for k in range(length):
        lanes[(e.first + k) * LANES + lane] = state[e.first + apart + k]
        lanes[(e.first + length + k) * LANES + lane] = state[e.first + length - apart + k]


def save(e: Ensemble, states: Floats, lanes: Floats, run: int, lane: int) -> None:
    """Take the state of a run out of a lane."""
    state = at(states, run * e.words)
    for k in range(e.words):
        state[k] = lanes[k * LANES + lane]
