"""The page of a model as one file: its run as WebAssembly, and data for its script.

The module has the kernels of the run (`lagsim.program.webassembly`). What lagsim does
in Python before and after a run, the page does in JavaScript from the data written
here: values and start values from the expressions of the file, guesses and the verdict
on a start from the nodes of the constraints, the film of the scene from its nodes.
"""

from __future__ import annotations

import json
import math
from itertools import chain, groupby
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from lagsim.admissibility.point import Point, gradient_of, positions_of, shape_of
from lagsim.admissibility.rank import analyse
from lagsim.codes import number
from lagsim.codes.known import (
    EXPRESSION_ARITY,
    EXPRESSION_NAME,
    EXPRESSION_NOT_FINITE,
    EXPRESSION_NUMBER,
    EXPRESSION_PARENTHESIS,
    EXPRESSION_SYNTAX,
    EXPRESSION_UNKNOWN_FUNCTION,
    INADMISSIBLE,
    LATER_INITIAL,
    LATER_PARAMETER,
    NEGATIVE_INERTIA,
    NO_INERTIA,
    NOT_CONSTANT,
    NOT_FINITE,
    NOT_IN_A_FILE,
    OUT_OF_RANGE,
    SINGULAR_MASS,
    UNKNOWN_NAME,
    USAGE,
)
from lagsim.errors import unusable
from lagsim.language.derivatives import gradient, slopes, tangent
from lagsim.language.graph import CONSTANT, DATA, TRUTH, VARIABLE
from lagsim.language.names import in_file
from lagsim.limits import STEPS
from lagsim.mechanics.surfaces import expression_text
from lagsim.model.model import CURVE, SHAPES
from lagsim.native.graph.tapes import by_columns
from lagsim.native.link import wasm
from lagsim.native.link.engine import NativeError
from lagsim.outputs import ENERGIES
from lagsim.outputs import animation as pictures
from lagsim.outputs.animation.carriers import MOST_PUSHES, Carriers, ConstraintPoints
from lagsim.outputs.animation.pages import holding
from lagsim.outputs.letters import raised_powers
from lagsim.outputs.shapes import ALONG, CHANGING, mesh_parts, moving
from lagsim.outputs.units import units
from lagsim.plan.method_choice import ANY
from lagsim.plan.plan import without_partition
from lagsim.program import webassembly
from lagsim.run.arc import SERIES, largest_shift
from lagsim.run.arcs import Run
from lagsim.run.failures import FAILURES
from lagsim.run.observers.thinning import Frames
from lagsim.run.trajectory import Outcome
from lagsim.studies.explore.explorer import MOST_ROWS
from lagsim.studies.trial import tried
from lagsim.tolerances import (
    COMPUTED_ZERO,
    DEPENDENT_ROWS,
    HALF_OF_DIGITS,
    SAME_STEP,
    SATISFIED,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from lagsim.codes.known import ErrorCode
    from lagsim.language.parser import Parsed
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model
    from lagsim.outputs.animation import Film
    from lagsim.outputs.shapes import Body
    from lagsim.run.arc import Arc
    from lagsim.run.session import Session
    from lagsim.studies.explore.explorer import Explorer

    Document = dict[str, Any]

# Error codes whose numbers appear in messages of the page, by the names there.
NUMBERS: dict[str, ErrorCode] = {
    "syntax": EXPRESSION_SYNTAX, "name": EXPRESSION_NAME,
    "number": EXPRESSION_NUMBER, "not-finite": EXPRESSION_NOT_FINITE,
    "parenthesis": EXPRESSION_PARENTHESIS, "arity": EXPRESSION_ARITY,
    "unknown-function": EXPRESSION_UNKNOWN_FUNCTION, "unknown-name": UNKNOWN_NAME,
    "later-parameter": LATER_PARAMETER, "later-initial": LATER_INITIAL,
    "not-constant": NOT_CONSTANT, "not-finite-value": NOT_FINITE,
    "out-of-range": OUT_OF_RANGE, "usage": USAGE, "inadmissible": INADMISSIBLE,
    "no-inertia": NO_INERTIA, "negative-inertia": NEGATIVE_INERTIA,
    "singular-mass": SINGULAR_MASS, "not-in-a-file": NOT_IN_A_FILE,
}  # fmt: skip
# The outcomes of a module's codes.
OUTCOMES = {
    "NOT_FINITE": Outcome.NOT_FINITE, "STEP_TOO_SMALL": Outcome.STEP_TOO_SMALL,
    "PROJECTION_FAILED": Outcome.PROJECTION_FAILED,
    "NEWTON_FAILED": Outcome.NEWTON_FAILED, "STATE_JUMPS": Outcome.STATE_JUMPS,
    "TOO_MANY_STEPS": Outcome.TOO_MANY_STEPS,
}  # fmt: skip
ONE_PLAN = "a page in a file cannot change the solver within a run"
LIVE = "`lagsim explore` without -o integrates it"


class Node(int):
    """Node of the model's graph in the data of a page, until nodes are renumbered."""


def page_in_a_file(explorer: Explorer) -> bytes:
    """Return the HTML page of a model with its run as WebAssembly.

    Raises
    ------
    LagsimError
        If the start is not admissible, or a page cannot compute what the model needs.
    """
    session = explorer.session
    if session.plan.blocks:
        session = session.case.ready(without_partition(session.plan, ONE_PLAN))
    _refuse(session)
    observed = pictures.frames_of(session.equations, session.columns.names)
    frames = Frames(
        session.columns.names,
        tuple(dict.fromkeys((*session.columns.of_table, *observed.names))),
        MOST_ROWS,
    )
    ended = tried(session, observer=frames).trajectory
    if ended.choices:
        raise _refused(f"another method within the run ({ended.choices[0].choice})")
    run = Run(session.first_arc(), [])
    run.begin()
    try:
        module = webassembly.module(run.arc.runner, run.arc.state)
    except NativeError as error:
        raise _refused(str(error)) from None
    names = units(session.equations, session.columns.of_table)
    film = pictures.film(session.equations, frames, (), units=names)
    document = {
        **_problem(session, explorer),
        **_settings(session, run.arc),
        **_columns(session, frames, names),
        "ends": explorer.ends(
            session, dict(zip(frames.names, frames.table.T, strict=True))
        ),
        "scene": _scene(session, film, frames),
        "file": _places(session.case.model),
    }
    document = _numbered(document, session)
    about = explorer.document | {"fault": "", "sliders": _sliders(explorer)}
    tapes = wasm.tapes(module)
    for first, size in tapes:
        end = first + size
        module = module[:first] + by_columns(module[first:end]) + module[end:]
    equations = explorer.equations().encode()
    return holding(about, _text(document), module, tapes, equations)


def _sliders(explorer: Explorer) -> list[Any]:
    """Return the sliders of a page in a file, as data for its script.

    The number of members of a family has no slider there.
    """
    found = []
    for x in explorer.document["sliders"]:
        if not x["whole"]:
            found.append(x)
        elif x["name"] in explorer.varied:
            raise _refused(f"another number of members, `{x['name']}`")
    return found


def _text(document: Document) -> bytes:
    return json.dumps(
        document, ensure_ascii=False, separators=(",", ":"), allow_nan=False
    ).encode()


# --- Features that a page cannot compute


def _refused(feature: str) -> Exception:
    text = f"a page in a file cannot compute {feature}"
    return unusable(NOT_IN_A_FILE, text)


def _refuse(session: Session) -> None:
    """Raise an error that names the first feature that a page cannot compute."""
    for feature in _features(session):
        raise _refused(feature)


def _features(session: Session) -> Iterator[str]:
    """Yield the names of the features of a model for which there can be no page."""
    case, system = session.case, session.system
    model, settings = case.model, case.settings
    for event in model.events:
        yield f"the event `{event.name}`"
    if model.until is not None:
        yield f"`until: {model.until.text}`"
    for law in case.equations.laws:
        yield law.role.phrase.format(law.constraint)
    graph = case.equations.graph
    if any(op == DATA for op in graph.ops):
        yield from (f"the table `{table.name}`" for table in model.tables)
    for side in session.plan.switches.sides:
        if not side.shown:
            yield f"the switch `{side.text}`"
    if settings.rest:
        yield "`begin: rest`"
    for mode in system.switches.modes:
        yield f"the switch `{expression_text(graph, mode.discrete)}` in t"


# --- The problem: values, start, constraints


def _problem(session: Session, explorer: Explorer) -> Document:
    case, e = session.case, session.equations
    model, point = case.model, Point(e, case.start)
    formulas = model.stated.formulas()
    stated = sorted(
        model.initial, key=lambda x: (not x.text, x.place.line, x.place.column)
    )
    found: Document = {
        "name": model.name,
        "description": model.description,
        "parameters": [
            {"name": p.name, "steps": _steps(formulas[p.name])}
            for p in model.parameters
        ],
        "initial": [
            {"name": x.name, "guess": x.guess,
             "steps": _steps(formulas[x.name]) if x.name in formulas else [0]}
            for x in stated
        ],
        "started": [*e.state, *(x.name for x in model.initial if x.node is not None)],
        "overridden": explorer.overridden,
        "structural": sorted(model.stated.structural()),
        "q": list(e.q), "v": list(e.velocities), "s": [x.name for x in e.states],
        "kept": list(session.system.equations.state),
        "base": {**point.values},
        "numbers": {name: number(code) for name, code in NUMBERS.items()},
        "rows": [
            {
                "name": r.name, "holonomic": r.holonomic,
                "kind": "holonomic" if r.holonomic else "nonholonomic",
                "residual": Node(r.residual), "residualScale": Node(r.residual_scale),
                "rate": Node(r.rate), "rateScale": Node(r.rate_scale),
                "A": _slopes(r.A.entries),
            }
            for r in e.rows
        ],
        "shapes": list(_shapes_of_rows(e)),
        "mass": [
            [i, j, Node(node)]
            for i, row in enumerate(e.M)
            for j, node in row.entries.items()
        ],
        "augmented": case.start.augmented,
        "rank": analyse(point).rank if e.rows else 0,
        "defined": list(_defined(e, point)),
        "states": list(_states(e)),
        "finite": list(_finite(e)),
        "forces": [Node(node) for node in e.f],
    }  # fmt: skip
    words = session.system.length_words
    found["lengths"] = [
        {"value": length, "words": words(k)}
        for k, length in enumerate(session.plan.lengths)
    ]
    if session.plan.reduction.eliminated:
        found["lengths"] = []
    return found


def _shapes_of_rows(e: Equations) -> Iterator[Document]:
    """Yield, for each constraint row, its gradient and derivatives of the gradient.

    Each document has the columns of the gradient, the positions (`ways`) on which it
    depends, and the nodes of the gradient and of its first and second derivatives.
    """
    positions = positions_of(e)
    for row in e.rows:
        columns = list(row.A.entries)
        ways, table = shape_of(e.graph, positions, list(row.A.entries.values()))
        yield {"columns": columns, "ways": ways, "table": [Node(x) for x in table]}


def _steps(parsed: Parsed) -> list[Any]:
    """Return an expression in postfix notation, as data for the script of the page."""
    return [
        payload if kind in ("number", "name") else [kind, payload]
        for kind, payload, _ in parsed.postfix
    ]


def _slopes(entries: Mapping[int, int]) -> list[Any]:
    return [[j, Node(node)] for j, node in entries.items()]


def _defined(e: Equations, point: Point) -> Iterator[Document]:
    """Yield each stated start value of a definition as a condition on the start.

    A condition is a document with the node of the definition, its derivatives at
    `point` by coordinates or velocities, and its value.
    """
    n, velocities = len(e.q), frozenset(e.velocities)
    for x in e.model.initial:
        if x.node is None:
            continue
        block = int(bool(e.graph.depends([x.node]) & velocities))
        every = gradient_of(point, x.node)
        A = {j - n * block: node for j, node in every.items() if (j >= n) == block}
        yield {
            "name": x.name, "block": block, "node": Node(x.node), "A": _slopes(A),
            "value": x.value,
        }  # fmt: skip


def _states(e: Equations) -> Iterator[Document]:
    """Yield name, rate and derivatives of the rate of each first-order state.

    The rate is a node, or 0 in a steady state. The derivatives are the nodes of the
    nonzero derivatives of the rate by all first-order states.
    """
    every = [e.graph.variable(x.name) for x in e.states]
    for x in e.states:
        A = dict(enumerate(gradient(e.graph, x.rate, every)))
        A = {j: node for j, node in A.items() if node != e.graph.zero}
        yield {"name": x.name, "rate": Node(x.rate), "A": _slopes(A)}


def _finite(e: Equations) -> Iterator[Document]:
    """Yield the nodes that must be finite at an admissible start, with names."""
    model = e.model
    energies = {"kinetic": model.kinetic, "potential": model.potential}
    if model.kinetic is None:
        energies = {"lagrangian": model.lagrangian}
    for name, node in energies.items():
        if node is not None:
            yield {"what": f"the energy `{name}`", "node": Node(node)}
    for name, node in zip(e.q, e.f, strict=True):
        yield {"what": f"the force on `{name}`", "node": Node(node)}
    for row in e.rows:
        for node in (row.residual, row.rate, row.b, *row.A.entries.values()):
            yield {"what": f"the constraint `{row.name}`", "node": Node(node)}


# --- Settings, columns, and the text of the file


def _settings(session: Session, arc: Arc) -> Document:
    settings, steps = session.case.settings, {}
    formulas = session.case.model.stated.formulas()
    for key in ("start", "duration", "end", "output_step"):
        if (parsed := formulas.get(f"simulation.{key}")) is not None:
            steps[key] = _steps(parsed)
    used = {x for parts in steps.values() for x in parts if isinstance(x, str)}
    for key in ("rtol", "atol", "step", "gain"):
        parsed = formulas.get(f"simulation.{key}")
        if parsed is not None and {x.text for x in parsed.names} - {"pi"}:
            raise _refused(f"`simulation.{key}` that depends on parameters")
    return {
        "settings": {
            "base": {
                "start": settings.start, "end": settings.end,
                "output_step": settings.output_step,
            },
            "steps": steps if used - {"pi"} else None,
            "rows": 1000,
        },
        "sameStep": SAME_STEP,
        "mostSteps": STEPS,
        "dynamic": arc.state.dynamic.stop,
        "largestShift": largest_shift(session.plan.rtol),
        "fallback": _fallback(session),
        "failures": {
            **{name: _failure(outcome) for name, outcome in OUTCOMES.items()},
            "other": {
                "text": "the constraints become dependent, or a step is impossible,",
                "advice": LIVE,
                "number": number(NOT_IN_A_FILE),
            },
        },
    }  # fmt: skip


def _fallback(session: Session) -> str:
    """Return words on the method with which lagsim continues after a failure.

    "" if no other method takes over.
    """
    name, requested = session.plan.method, session.case.settings.method
    if name == ANY or (requested != "auto" and name != SERIES):
        return ""
    return f"from this time on a run of lagsim uses {ANY} in place of {name}: {LIVE}"


def _failure(outcome: Outcome) -> Document:
    known = outcome.failure or {}
    text = FAILURES[outcome].replace("{about}", "")
    return {"text": text, "advice": outcome.advice, "number": known.get("number", "")}


def _columns(session: Session, frames: Frames, about: Mapping[str, str]) -> Document:
    return {
        "wanted": list(frames.names),
        "table": len(session.columns.of_table),
        "units": {name: raised_powers(unit) for name, unit in about.items()},
        "stateNames": ["t", *session.equations.state],
        "mostRows": MOST_ROWS,
    }


def _places(model: Model) -> Document:
    """Return the text of the model file, and the places of its numbers in the text."""
    text, spans, added = model.stated.places()
    given = list(spans.values())

    def place(k: int) -> int:
        # Strings of JavaScript count halves of the letters beyond 2^16.
        return len(text[:k].encode("utf-16-le")) // 2

    return {
        "text": text,
        "spans": {
            name: "shared" if given.count(span) > 1 else [place(x) for x in span]
            for name, span in spans.items()
        },
        "names": {name: in_file(name) for name in spans},
        "added": added and {"at": place(added[0]), "between": added[1]},
    }


# --- The scene


def _scene(session: Session, film: Film | None, frames: Frames) -> Document:
    e, g = session.equations, session.equations.graph
    model = e.model
    scene = pictures.stage(model)
    seed = e.flow.forward | dict(
        zip(e.flow.rates, map(g.variable, e.accelerations), strict=True)
    )
    found: Document = {
        "dimension": 2, "points": [], "links": [], "shapes": [], "pushes": [],
        "reactions": [], "units": dict(film.units) if film else {},
        "energies": [x for x in ENERGIES if x in frames.names],
        "swift": pictures.SWIFT, "zero": COMPUTED_ZERO, "most": pictures.MOST,
        "outlying": pictures.OUTLYING, "near": pictures.NEAR, "rigid": pictures.RIGID,
        "taut": pictures.TAUT, "satisfied": SATISFIED,
        "dependent": DEPENDENT_ROWS, "half": HALF_OF_DIGITS,
    }  # fmt: skip
    if film is None:
        return found
    index = {g.variable(name): j for j, name in enumerate(e.q)}
    names = list(scene.points)
    for name, parts in scene.points.items():
        rates = tangent(g, parts, seed)
        along = [slopes(g, node, frozenset(index)) for node in parts]
        found["points"].append({
            "name": name,
            "nodes": [Node(x) for x in parts],
            "rates": [Node(x) for x in rates],
            "slopes": [_slopes({index[v]: s for v, s in row.items()}) for row in along],
        })  # fmt: skip
    struck = [set(points) for points in film.struck.values()]
    kinds = film.looks or ("",) * len(film.links)
    lengths = scene.lengths or (None,) * len(film.links)
    found["links"] = [
        {
            "ends": [names.index(a), names.index(b)], "look": kind,
            "length": None if length is None else Node(length.node),
            "struck": any({a, b} & points for points in struck),
        }
        for (a, b), kind, length in zip(film.links, kinds, lengths, strict=True)
    ]  # fmt: skip
    found["dimension"] = film.dimension
    found["shapes"] = [_shape(model, body, names) for body in film.shapes]
    table = frames.table
    columns = {name: table[:, k] for k, name in enumerate(frames.names)}
    values = {p.name: p.value for p in model.parameters} | columns
    with np.errstate(all="ignore"):
        carriers = Carriers(e, scene, values, len(table))
    found["pushes"] = [
        _push(x, carriers, g.zero, names, film.dimension)
        for x in carriers.carried[:MOST_PUSHES]
        if x.multiplier in frames.names
    ]
    pushed = {
        d.node: d.name for d in model.definitions if d.name in model.output.reactions
    }
    for point, parts in scene.points.items():
        own = [f"reaction.{pushed[x]}" if x in pushed else None for x in parts]
        own = [x if x in columns else None for x in own]
        if any(own):
            found["reactions"].append({"point": names.index(point), "parts": own})
    return found


def _push(
    x: ConstraintPoints,
    carriers: Carriers,
    zero: int,
    names: Sequence[str],
    dimension: int,
) -> Document:
    """Return data of the equation A^T = J^T f for the forces f on points.

    A is the row of a constraint, J has the derivatives of its points by the
    coordinates, and f are the forces on the points per unit multiplier.

    Parameters
    ----------
    x : ConstraintPoints
        The row A of the constraint, and its points.
    carriers : Carriers
        Derivatives of points by the coordinates.
    zero : int
        The node of 0.
    names : sequence of str
        All points.
    dimension : int
        Number of components of points.
    """
    jacobians = [carriers.jacobians[point] for point in x.points]
    rows = [part for parts in jacobians for part in parts if part]
    columns = sorted({j for part in rows for j in part})
    count, parts = 0, []
    for own in jacobians:
        mine: list[int | None] = []
        for part in own:
            mine.append(count if part else None)
            count += bool(part)
        parts.append(mine + [None] * (dimension - len(mine)))
    return {
        "name": x.constraint, "multiplier": x.multiplier,
        "points": [names.index(point) for point in x.points], "parts": parts,
        "jacobian": [[Node(part.get(j, zero)) for j in columns] for part in rows],
        "row": [Node(x.row.get(j, zero)) for j in columns],
    }  # fmt: skip


def _shape(model: Model, body: Body, names: Sequence[str]) -> Document:
    shape = body.shape
    corners = [node for corner in shape.corners for node in corner]
    found: Document = {
        "name": shape.name, "kind": shape.kind, "moves": body.moves,
        "point": names.index(shape.point) if shape.point else None,
        "carried": bool(shape.point) and bool(shape.at),
        "level": body.height is not None, "sized": bool(SHAPES[shape.kind].sizes),
        "sizes": [Node(x) for x in shape.sizes], "at": [Node(x) for x in shape.at],
        "axes": [Node(x) for x in shape.axes],
        "corners": [[Node(x) for x in corner] for corner in shape.corners],
        "faces": body.faces, "edges": body.edges, "seams": body.seams,
    }  # fmt: skip
    if shape.corners:
        own = moving(model, corners)
        found |= {"changes": bool(own), "needs": sorted(own)}
        found |= {"along": ALONG, "changing": CHANGING, "parameter": CURVE}
    else:
        parts = mesh_parts(shape, model.scene.dimension)
        found["mesh"] = {
            "many": len(parts[0]),
            "parts": [np.round(part, 12).ravel().tolist() for part in parts],
        }
    return found


# --- Nodes


def _numbered(document: Document, session: Session) -> Document:
    """Return the data with its nodes numbered from 0, and the nodes in that order."""
    g = session.equations.graph
    groups = list(_groups(session, g.cone(sorted(set(_nodes_in(document))))))
    place = {n: k for k, n in enumerate(chain.from_iterable(groups))}

    def again(x: Any) -> Any:
        if isinstance(x, Node):
            return place[int(x)]
        if isinstance(x, dict):
            return {key: again(value) for key, value in x.items()}
        if isinstance(x, (list, tuple)):
            return [again(value) for value in x]
        return x

    made: Document = again(document)
    made["nodes"] = []
    last = 0
    for nodes in groups:
        op, width = g.ops[nodes[0]], len(g.args[nodes[0]])
        given = [place[g.args[n][k]] for k in range(width) for n in nodes]
        change = np.diff(given, prepend=last).tolist()
        last = given[-1] if given else last
        made["nodes"].append([*_leaves(session, nodes)] or [op, width, *change])
    return made


def _nodes_in(x: Any) -> Iterator[int]:
    if isinstance(x, Node):
        yield int(x)
    parts: Iterable[Any] = ()
    if isinstance(x, dict):
        parts = x.values()
    elif isinstance(x, (list, tuple)):
        parts = x
    for part in parts:
        yield from _nodes_in(part)


def _groups(session: Session, cone: Sequence[int]) -> Iterator[list[int]]:
    """Yield lists of nodes of one operation, operands before the nodes that use these.

    Nodes of a list have one level: 1 more than the highest level of their operands.

    cone : the nodes to be grouped.
    """
    g = session.equations.graph
    level = dict[int, int]()
    for n in cone:
        level[n] = max([level[a] + 1 for a in g.args[n]], default=0)
    place = dict[int, int]()

    def order(n: int) -> tuple[Any, ...]:
        return g.ops[n], len(g.args[n]), [place[a] for a in g.args[n]]

    for _, own in groupby(sorted(cone, key=level.__getitem__), level.__getitem__):
        nodes = sorted(own, key=order)
        place |= {n: len(place) + k for k, n in enumerate(nodes)}
        for _, group in groupby(nodes, lambda n: order(n)[:2]):
            yield list(group)


def _leaves(session: Session, nodes: Sequence[int]) -> Iterator[Any]:
    """Yield the items of one group of leaves in the data of the page.

    The items are `$` and 1, then the names of variables; or `=` and 1, then the
    values of constants.

    nodes : the leaves, all variables or all constants.
    """
    g = session.equations.graph
    op = g.ops[nodes[0]]
    if op == VARIABLE:
        yield from ("$", 1, *map(g.payload, nodes))
    if op in (CONSTANT, TRUTH):
        values = [float(cast("float", g.payload(n))) for n in nodes]
        # JSON has no infinity; `Number` of the page reads the word.
        words = [str(x).replace("inf", "Infinity") for x in values]
        finite = map(math.isfinite, values)
        yield from ("=", 1, *(
            x if known else word
            for x, known, word in zip(values, finite, words, strict=True)
        ))  # fmt: skip
