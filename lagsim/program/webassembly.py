"""A compiled run as a WebAssembly module, with a description of how to run it.

The module contains the compiled kernels and functions of native runs, and the initial
memories. Its rows equal those of runs with LAGSIM_CPU=portable, bit for bit.

The module imports nothing. It exports its memory and three functions, whose arrays are
addresses in the memory:

    prepare(t: f64, y, p, out)        after a change of parameters; y, out: 0
    advance(s, p, out, rows: i64, steps: i64) -> i64    the next rows; a code
    tabulate(rows, count: i64, size: i64, p, columns, width: i64)    columns of rows

and a custom section "lagsim", JSON in UTF-8:

    version       of this description
    lagsim, model, method, state, columns   names, as in run.json
    places        addresses: of `s` (state), p (parameters), rows, columns
    tapes         addresses of tapes (instructions as data)
    block         the number of rows for which there is room
    parameters    value, and word in p: a number at p + 8 word
    words         words in s of its numbers, and of the first of its arrays
    codes         results of `advance`: BLOCK_FULL and PAUSED, the run continues; DONE
                  and EVENT_FOUND (`until`), the last row is the state, from word `y` on
                  at time `t`; STIFF, after as many steps limited by stability as word
                  `pause_at` says (0: never); all other codes are failures

Rows have 1 + size numbers, the time and the state; word `emitted` is the number of rows
written. A change of parameters does not change the start: the caller sets initial
values that depend on them. Runs with events in the state or switches have no module,
since Python code connects their arcs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from lagsim.methods.parts import state as at
from lagsim.native.layout import ARRAY, NUMBER
from lagsim.native.link import cache, engine, wasm
from lagsim.version import __version__

if TYPE_CHECKING:
    from lagsim.methods.parts.driver import State
    from lagsim.program.system import Runner

VERSION: Final = 1
"""Version of the description, increased where readers of the former would fail."""

EXPORTS: Final = ("prepare", "advance", "tabulate")
CODES: Final = (
    "DONE", "BLOCK_FULL", "PAUSED", "EVENT_FOUND", "STEP_TOO_SMALL", "NOT_FINITE",
    "PROJECTION_FAILED", "DEGENERATE", "RANK_LOST", "NEWTON_FAILED", "STIFF",
)  # fmt: skip


def module(runner: Runner, state: State) -> bytes:
    """Return the WebAssembly module of a run, as bytes.

    Parameters
    ----------
    runner : Runner
        Its system's memory has the parameters as prepared for an arc.
    state : State
        The start of the run.

    Raises
    ------
    NativeError
        If the run needs Python code between arcs.
    """
    system = runner.system
    beside = system.watched or system.switches.modes
    if beside or state.extras or system.model.events:
        text = "switches, contacts, events and moments need Python "
        raise engine.NativeError(f"{text}between arcs: they have no module")
    target = engine.wasm_target()
    code = cache.linked(runner.program, wasm.STACK_IR, EXPORTS, target)
    rows, width = runner.block.shape
    columns = system.rows_observed
    images: dict[str, bytes | int] = {
        "state": state.flat.tobytes(),
        "parameters": system.p.flat.tobytes(),
        "rows": 8 * rows * width,
        "columns": 8 * rows * columns,
    }
    return wasm.module(code, EXPORTS, images, _described(runner, state))


def _described(runner: Runner, state: State) -> dict[str, Any]:
    system = runner.system
    words = {
        name: field.word if field.kind == NUMBER else state.place(name)
        for name, field in type(state).fields.items()
        if field.kind in (NUMBER, ARRAY)
    }
    return {
        "version": VERSION,
        "lagsim": __version__,
        "model": system.model.name,
        "method": system.plan.method,
        "state": system.state,
        "columns": system.columns.names,
        "block": len(runner.block),
        "parameters": {
            x.name: {"word": system.place(x.name), "value": x.value}
            for x in system.model.parameters
        },
        "words": words,
        "codes": {getattr(at, name): name for name in CODES},
    }
