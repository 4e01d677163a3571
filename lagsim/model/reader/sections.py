"""The sections of a model file: every key, what it is for, and what may stand there.

One table, written as the JSON Schema (draft-07) that editors use. Reading takes the
keys from it, and hints where a key belongs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lagsim.errors import UNSEEN
from lagsim.language.functions import JOINING
from lagsim.methods import options

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping

Form = dict[str, Any]

EXPRESSION: Form = {"type": ["number", "string"]}
PLAIN: Form = {"type": ["string", "number", "boolean", "null"]}
TRUTH: Form = {"type": "boolean"}
IGNORED: Form = {"patternProperties": {"^x-": {}}}

RESERVED = (
    "t", "pi", "kinetic", "potential", "lagrangian", "energy", "work",
)  # fmt: skip
# A letter, then letters, digits and `_`. Patterns know no letters but those of ASCII,
# so that anything beyond ASCII passes.
_NAME = r"^(x-.*|[^\x00-@\[-`{-\x7f][^\x00-/:-@\[-^`{-\x7f]*)$"


def described(about: str, form: Form) -> Form:
    """Give the form of what stands at a key, with what it is for."""
    return {**form, "description": about}


def expressions(**about: str) -> dict[str, Form]:
    """Give keys of expressions, each with what it is for."""
    return {key: described(text, EXPRESSION) for key, text in about.items()}


def either(*forms: Form) -> Form:
    """Give the form of what has one of these."""
    return {"anyOf": list(forms)}


def listing(form: Form, least: int = 0, most: int | None = None) -> Form:
    """Give the form of a list of so many."""
    bound = {} if most is None else {"maxItems": most}
    return {"type": "array", "items": form, "minItems": least, **bound}


def keyed(keys: Mapping[str, Form], required: Collection[str] = ()) -> Form:
    """Give the form of a mapping with known keys."""
    return {
        "type": "object" if required else ["object", "null"],
        "properties": dict(keys),
        **IGNORED,
        "additionalProperties": False,
        "required": list(required),
    }


def naming(form: Form, *, rates: bool = False) -> Form:
    """Give the form of a mapping whose keys are names, or `rates` of what has one."""
    forbidden: list[Form] = [{"enum": [*RESERVED, *JOINING]}]
    if not rates:
        forbidden.append({"pattern": "_d?dot$"})
    return {
        "type": ["object", "null"],
        "propertyNames": {"pattern": _NAME, "not": {"anyOf": forbidden}},
        **IGNORED,
        "additionalProperties": form,
    }


DESCRIPTION = described("Plain text.", PLAIN)
UNIT = described(
    "Plain text; numbers are not scaled by it.", {**PLAIN, "pattern": r"^[^\n]*$"}
)
COORDINATE = {"unit": UNIT, "description": DESCRIPTION}
VALUE = {**expressions(value="An expression."), **COORDINATE}
VALUES = naming(either(EXPRESSION, keyed(VALUE, ["value"])))
START = expressions(guess="Solved for from the constraints, near this.")

ENERGY = expressions(
    kinetic="The kinetic energy T.",
    potential="The potential energy V; where there is none, 0.",
    lagrangian="L, instead of `kinetic` and `potential`.",
    dissipation="Rayleigh's function F: the force on each coordinate is -dF/dq_dot.",
)
_LAGRANGIAN = {
    "required": ["lagrangian"],
    "properties": {"kinetic": False, "potential": False},
}
FORCE = described(
    "The force p on what the key names, a coordinate or a definition of positions "
    "or linear in the velocities: it does the work p times its change.",
    EXPRESSION,
)
FRICTION = expressions(
    static="Coefficient of what sticks, at least that of sliding.",
    dynamic="Coefficient of what slides.",
)
# What only contacts have.
CONTACT = {
    **expressions(
        restitution="Of a one-sided relation between positions: 0 stays down, 1 "
        "bounces back."
    ),
    "friction": described(
        "Coefficient of friction; needs `slip`.",
        either(EXPRESSION, keyed(FRICTION, FRICTION)),
    ),
    "slip": described(
        "The sliding velocity that friction opposes: one expression, or two.",
        either(EXPRESSION, listing(EXPRESSION, 1, 2)),
    ),
}
CONSTRAINT = {
    **expressions(relation="lhs = rhs, lhs <= rhs or lhs >= rhs."),
    **CONTACT,
    **expressions(
        limit="Of an equality between velocities: the largest size of its "
        "multiplier, past which it slips.",
        when="In force while this condition, of t and parameters, is true.",
    ),
    "description": DESCRIPTION,
}
_LAW = {
    **keyed(CONSTRAINT, ["relation"]),
    "dependencies": {"friction": ["slip"], "slip": ["friction"]},
}

SIMULATION = {
    **expressions(
        start="When the run begins; default 0.",
        duration="How long it lasts, more than 0; or `end`.",
        end="When the run ends; or `duration`.",
        until="A relation at which the run stops, if before the end.",
        output_step="Spacing of the rows; default duration/1000.",
    ),
    "method": described("The integration method, see `lagsim methods`.", PLAIN),
    **expressions(
        rtol="Relative tolerance; default 1e-11.",
        atol="Absolute tolerance; default rtol times the component's own scale.",
        step="Only for methods of a fixed step.",
    ),
    "formulation": described(
        "How constraints are satisfied, and what is left out.", PLAIN
    ),
    **expressions(
        gain="Only for the formulation baumgarte, per unit of time; default "
        "0.1/output_step.",
        **{
            key: f"Only for the method {name}, {x.least:g} to {x.most:g}: {x.about}."
            for key, (name, x) in options().items()
        },
    ),
}

SCENE = {
    "points": described(
        "name: [x, y] or [x, y, z], expressions.", naming(listing(EXPRESSION, 2, 3))
    ),
    "links": described(
        "Lines between points: [[pivot, bob]].", listing(listing(PLAIN, 2, 2))
    ),
}
# As many as pens tell apart.
MOST_CURVES = 6
AXES = ("x", "y", "y2")
_CURVES = either(EXPRESSION, listing(EXPRESSION, 1, MOST_CURVES))
_AXIS = {"enum": list(AXES)}
PLOT = {
    **expressions(x="What runs to the right, any expression."),
    "y": described("What runs upwards, any expression, or a list of them.", _CURVES),
    "y2": described(
        "What runs upwards on a scale of its own at the right: as `y`.", _CURVES
    ),
    "log": described(
        "Axes that show powers of ten: x, y, y2, or a list of these.",
        either(_AXIS, listing(_AXIS)),
    ),
    "title": described("Plain text above the picture.", PLAIN),
}
OUTPUT_KEYS = {
    "columns": described(
        "The definitions that become columns, in this order; default: all.",
        listing(PLAIN),
    ),
    "plots": described("A picture each.", listing(keyed(PLOT, ["x", "y"]))),
    "gauss": described("Adds columns of Gauss's principle.", TRUTH),
    "action": described("Adds a column of the action.", TRUTH),
    "reactions": described(
        "Definitions: adds for each the force that holds it to its expression.",
        listing(PLAIN),
    ),
    "event_marks": described("Whether pictures mark events; default: true.", TRUTH),
}

SECTIONS = {
    "lagsim": described("Version of the format; default 1.", {"enum": [1, "1"]}),
    "name": described(
        "What the results are called; default: the file's stem.",
        {**PLAIN, "pattern": rf"^[^/\\\n\t{UNSEEN}]+$", "not": {"enum": [".", ".."]}},
    ),
    "description": DESCRIPTION,
    "source": described("Where the model comes from, plain text.", PLAIN),
    "parameters": described(
        "name: expression of the parameters above, or a mapping with `value`.", VALUES
    ),
    "coordinates": described(
        "name: {unit: ..., description: ...}; their order is that of the table.",
        {**naming(keyed(COORDINATE)), "minProperties": 1},
    ),
    "definitions": described(
        "name: expression, in any order; each is a column.", VALUES
    ),
    "energy": described(
        "Energies, taken literally.",
        {
            **keyed(ENERGY),
            "type": "object",
            "oneOf": [{"required": ["kinetic", "potential"]}, _LAGRANGIAN],
        },
    ),
    "forces": described("Forces that no energy gives.", naming(FORCE)),
    "constraints": described(
        "name: relation, or a mapping.",
        naming(described("A relation, or one with a law.", either(EXPRESSION, _LAW))),
    ),
    "initial": described(
        "A start value for each coordinate; velocities that are not named are 0.",
        naming(either(EXPRESSION, keyed(START, START)), rates=True),
    ),
    "simulation": described(
        "When to stop, how finely, and how.",
        {**keyed(SIMULATION), "not": {"required": ["duration", "end"]}},
    ),
    "scene": described("What to draw.", keyed(SCENE)),
    "output": described("What to write.", keyed(OUTPUT_KEYS)),
}
REQUIRED = ("coordinates", "energy", "initial")


def has_key(section: str, key: str) -> bool:
    """Tell whether a section has a key of this name."""
    return key in SECTIONS[section].get("properties", ())


def schema(choices: Mapping[str, Iterable[str]]) -> Form:
    """Give the JSON Schema of the model file.

    Parameters
    ----------
    choices
        Of keys of `simulation` that are names, those that there are.
    """
    asked = SECTIONS["simulation"]
    chosen = {
        key: {**SIMULATION[key], "enum": list(names)} for key, names in choices.items()
    }
    asked = {**asked, "properties": {**SIMULATION, **chosen}}
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "lagsim model",
        "description": "A system by its energies, its start, and how to run it.",
        **keyed({**SECTIONS, "simulation": asked}, REQUIRED),
    }
