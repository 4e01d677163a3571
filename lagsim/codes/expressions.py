"""E2xx: expressions, names and relations."""

from __future__ import annotations

from lagsim.codes.row import Row

ROWS = (
    Row(
        "E201", "expression-syntax",
        "An expression is numbers, names and calls with an operator between each two.",
        "operators are + - * / ^, and every product is written with `*`",
        "definitions:\n  x: l*sin theta\n  y: -l*cos(theta)\n",
        found="An expression cannot be parsed.",
    ),
    Row(
        "E202", "expression-name",
        "A name begins with a letter, and is in its plain form.",
        "use letters, digits and `_`",
        "parameters: {m: 1, g: 9.81, l: 2*_m}\n",
        found="A name in an expression is not allowed.",
    ),
    Row(
        "E203", "expression-number",
        "A number is decimal, such as 0.5 or 1e-3.",
        "write it without units, separators and prefixes",
        "parameters: {m: 1, g: 9.81, l: 1_000}\n",
        found="A number in an expression is written in a way that is not allowed.",
    ),
    Row(
        "E204", "expression-not-finite",
        "A number is at most about 1.8e308.",
        "choose units in which numbers are nearer to 1",
        "parameters: {m: 1, g: 9.81, l: 1e999}\n",
        found="A number is too large for double precision.",
    ),
    Row(
        "E205", "expression-parenthesis",
        "Each parenthesis is opened and closed.",
        "count the parentheses",
        "definitions:\n  x: l*sin(theta\n  y: -l*cos(theta)\n",
        found="A parenthesis is not closed, or was never opened.",
    ),
    Row(
        "E206", "expression-arity",
        "A function has as many arguments as it takes.",
        "docs/model-file.md lists the functions and their arguments",
        "definitions:\n  x: l*atan2(theta)\n  y: -l*cos(theta)\n",
        found="A function has too many arguments, or too few.",
    ),
    Row(
        "E207", "expression-unknown-function",
        "Every function is one of the language.",
        "docs/model-file.md lists the functions; one of your own is a definition",
        "definitions:\n  x: l*sinn(theta)\n  y: -l*cos(theta)\n",
        found="An expression calls a function that does not exist.",
    ),
    Row(
        "E208", "not-an-expression",
        "The value is one expression, a text or a number.",
        "write one expression, in quotes where it has a comma",
        "definitions: {x: [l, theta], y: -l*cos(theta)}\n",
        found="A value is not an expression.",
    ),
    Row(
        "E209", "unknown-name",
        "A name is a parameter, a coordinate or a definition, or the rate of one.",
        "look for a name that is spelt otherwise",
        "definitions: {x: l*sin(thta), y: -l*cos(theta)}\n",
        found="An expression uses a name that is not defined.",
    ),
    Row(
        "E210", "unknown-parameter",
        "`--set` changes parameters and start values, `--vary` a parameter.",
        "correct the name, or give the parameter in the file",
        commands=("lagsim check pendulum.yaml --set mass=2",),
        found="An option names a parameter or a start value that the model does "
        "not have.",
    ),
    Row(
        "E211", "bad-name",
        "A name is letters, digits and `_`, and begins with a letter.",
        "choose such a name",
        "parameters: {m: 1, g: 9.81, l: 1, 2nd: 1}\n",
        found="A name has characters that are not allowed.",
    ),
    Row(
        "E212", "reserved-name",
        "A name differs from the reserved names of the language.",
        "choose another name",
        "parameters: {m: 1, g: 9.81, l: 1, t: 2}\n",
        found="A name is reserved.",
    ),
    Row(
        "E213", "name-clash",
        "Each name is given once in the whole file.",
        "rename one of the two",
        "parameters: {m: 1, g: 9.81, l: 1, theta: 2}\n",
        found="One name is given to two quantities.",
    ),
    Row(
        "E214", "column-clash",
        "A name differs from those of the table's columns.",
        "choose another name",
        "definitions: {x: l*sin(theta), y: -l*cos(theta), Qc_theta: 1}\n",
        found="A name is that of a column of the table.",
    ),
    Row(
        "E215", "cycle",
        "No definition depends on itself.",
        "write one of them without the others",
        "definitions: {x: y + 1, y: x - 1}\n",
        found="Definitions depend on each other in a cycle.",
    ),
    Row(
        "E216", "later-parameter",
        "A parameter uses only parameters above it.",
        "move it below what it uses",
        "parameters: {m: 2*l, g: 9.81, l: 1}\n",
        found="A parameter uses itself, or a parameter below it.",
    ),
    Row(
        "E217", "not-constant",
        "The value is a number, made of parameters and `pi`.",
        "name parameters and `pi` alone",
        "simulation: {duration: theta}\n",
        found="An expression that must be a number depends on the motion.",
    ),
    Row(
        "E218", "output-only",
        "Energies, forces and constraints use positions, velocities, time and "
        "parameters only.",
        "use accelerations and multipliers only in definitions for output",
        "forces: {theta: theta_ddot}\n",
        found="An expression uses accelerations, multipliers or other results of "
        "the motion.",
    ),
    Row(
        "E219", "velocity-not-allowed",
        "A quantity of positions does not depend on velocities.",
        "use positions only, or velocities only",
        "constraints: {wall: {relation: theta + theta_dot >= 0, restitution: 0}}\n",
        found="An expression depends on velocities, which is not allowed in its "
        "place.",
    ),
    Row(
        "E220", "no-rate",
        "Coordinates have rates, and definitions of positions and time.",
        "rates are those of coordinates and of definitions of positions and time",
        "definitions: {x: l*theta_dot, y: x_dot}\n",
        found="An expression asks for the rate of a quantity that has none.",
    ),
    Row(
        "E221", "not-finite",
        "Numbers, energies, forces and constraints have finite values at the start, "
        "and columns of a golden all along.",
        "look for a division by 0, or for a root or a logarithm of something negative",
        "parameters: {m: 1, g: 9.81, l: 1/0}\n",
        found="A value is infinite or not a number.",
    ),
    Row(
        "E222", "not-affine",
        "A slip, and a quantity that a force acts on, is a sum of velocities with "
        "factors that do not depend on velocities.",
        "write powers of velocities into the force",
        "definitions: {y: -l*cos(theta), v2: theta_dot^2}\nforces: {v2: 1}\n",
        found="An expression is not linear in the velocities.",
    ),
    Row(
        "E223", "not-of-time",
        "`when` is a comparison of time and parameters.",
        "write such as `t < 0.3`",
        "constraints: {held: {relation: theta = 1, when: theta < 2}}\n",
        found="The condition `when` depends on the motion.",
    ),
    Row(
        "E224", "no-coordinate",
        "A constraint contains a coordinate or a velocity.",
        "write what it constrains, such as q = 1",
        "constraints: {held: m = l}\n",
        found="A constraint contains no coordinate and no velocity.",
    ),
    Row(
        "E225", "not-a-contact",
        "Restitution and friction belong to gaps, relations of positions with `>=` or "
        "`<=`.",
        "leave the key out",
        "constraints: {way: {relation: theta_dot >= 0, restitution: 0.5}}\n",
        found="A relation of velocities has a key of contacts.",
    ),
    Row(
        "E226", "not-one-sided",
        "Restitution and friction belong to relations with `>=` or `<=`.",
        "write the relation with `>=`, or leave the key out",
        "constraints: {held: {relation: theta = 1, restitution: 0.5}}\n",
        found="An equality has a key of contacts.",
    ),
    Row(
        "E227", "not-an-equality",
        "`limit` and `when` belong to relations with `=`.",
        "write the relation with `=`, or leave the key out",
        "constraints: {held: {relation: theta >= 0, restitution: 0, limit: 1}}\n",
        found="A one-sided relation has a key of equalities.",
    ),
    Row(
        "E228", "not-a-velocity",
        "`limit` belongs to relations of velocities.",
        "write the rates of both sides",
        "constraints: {held: {relation: theta = 1, limit: 1}}\n",
        found="A relation of positions has a `limit`.",
    ),
    Row(
        "E229", "not-homogeneous",
        "A one-sided relation of velocities is homogeneous in them.",
        "leave out the terms without velocities",
        "constraints: {way: theta_dot >= 1}\n",
        found="A one-sided relation of velocities has a term without velocities.",
    ),
    Row(
        "E230", "not-a-direction",
        "A force acts along a coordinate, or along a definition of positions.",
        "name a coordinate, or a definition of what the force pushes",
        "forces: {m: 1}\n",
        found="A force acts on a name along which no force can act.",
    ),
    Row(
        "E231", "not-a-definition",
        "`columns` and `reactions` list names of definitions.",
        "write a definition for it",
        "output: {columns: [theta]}\n",
        found="A listed name is not a definition.",
    ),
    Row(
        "E232", "no-reaction",
        "A reaction belongs to a definition of positions that a constraint, an energy "
        "or a force uses.",
        "name a definition that a constraint, an energy or a force uses",
        "definitions: {y: -l*cos(theta), v: theta_dot}\noutput: {reactions: [v]}\n",
        found="A definition has no reaction.",
    ),
    Row(
        "E233", "multiple-root",
        "A relation has a simple zero: it is not a power.",
        "take the root of both sides",
        """\
coordinates: {q: {}, z: {}}
definitions: {x: q}
energy: {kinetic: (x_dot^2 + z_dot^2)/2, potential: 0}
constraints: {c: x*q = 0}
initial: {q: 0, z: 0}
output: {reactions: [x]}
""",
        ("lagsim run pendulum.yaml --no-plots",),
        found="A relation is the power of another expression, so that its gradient "
        "vanishes wherever it holds.",
    ),
    Row(
        "E234", "expression-too-long",
        "An expression is no longer than the limit that the message names.",
        "split it into definitions",
        commands=(
            "{ printf 'forces: {theta: '; seq -s+ 300000; echo '}'; } > long.yaml",
            "lagsim check long.yaml",
        ),
        found="An expression is too long.",
    ),
)  # fmt: skip
