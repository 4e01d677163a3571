"""E2xx: expressions, names and relations."""

from __future__ import annotations

from lagsim.codes.row import Row

ROWS = (
    Row(
        "E201", "expression-syntax",
        "An expression is numbers, names and calls with an operator between each two.",
        "operators are + - * / ^, and every product is written with `*`",
        "definitions:\n  x: l*sin theta\n  y: -l*cos(theta)\n",
    ),
    Row(
        "E202", "expression-name",
        "A name begins with a letter, and is in its plain form.",
        "use letters, digits and `_`",
        "parameters: {m: 1, g: 9.81, l: 2*_m}\n",
    ),
    Row(
        "E203", "expression-number",
        "A number is decimal, such as 0.5 or 1e-3.",
        "write it without units, separators and prefixes",
        "parameters: {m: 1, g: 9.81, l: 1_000}\n",
    ),
    Row(
        "E204", "expression-not-finite",
        "A number is at most about 1.8e308.",
        "choose units in which numbers are nearer to 1",
        "parameters: {m: 1, g: 9.81, l: 1e999}\n",
    ),
    Row(
        "E205", "expression-parenthesis",
        "Each parenthesis is opened and closed.",
        "count the parentheses",
        "definitions:\n  x: l*sin(theta\n  y: -l*cos(theta)\n",
    ),
    Row(
        "E206", "expression-arity",
        "A function has as many arguments as it takes.",
        "docs/model-file.md lists the functions and their arguments",
        "definitions:\n  x: l*atan2(theta)\n  y: -l*cos(theta)\n",
    ),
    Row(
        "E207", "expression-unknown-function",
        "What is called is a function of the language.",
        "docs/model-file.md lists the functions; one of your own is a definition",
        "definitions:\n  x: l*sinn(theta)\n  y: -l*cos(theta)\n",
    ),
    Row(
        "E208", "not-an-expression",
        "The value is one expression, a text or a number.",
        "write the expression without brackets, in quotes where it has a comma",
        "definitions: {x: [l, theta], y: -l*cos(theta)}\n",
    ),
    Row(
        "E209", "unknown-name",
        "A name is a parameter, a coordinate, a definition, or made of these.",
        "give the name a value in `parameters`, or define it",
        "definitions: {x: l*sin(thta), y: -l*cos(theta)}\n",
    ),
    Row(
        "E210", "unknown-parameter",
        "`--set` and `--vary` change parameters of the model.",
        "give the parameter in the file, or correct the name",
        commands=("lagsim check pendulum.yaml --set mass=2",),
    ),
    Row(
        "E211", "bad-name",
        "A name is letters, digits and `_`, and begins with a letter.",
        "choose such a name",
        "parameters: {m: 1, g: 9.81, l: 1, 2nd: 1}\n",
    ),
    Row(
        "E212", "reserved-name",
        "A name is none that the language has taken.",
        "choose another name",
        "parameters: {m: 1, g: 9.81, l: 1, t: 2}\n",
    ),
    Row(
        "E213", "name-clash",
        "A name is given once in the whole file.",
        "rename one of the two",
        "parameters: {m: 1, g: 9.81, l: 1, theta: 2}\n",
    ),
    Row(
        "E214", "column-clash",
        "No name is that of a column of the table.",
        "choose another name",
        "definitions: {x: l*sin(theta), y: -l*cos(theta), Qc_theta: 1}\n",
    ),
    Row(
        "E215", "cycle",
        "Definitions do not go round in a circle.",
        "write one of them without the others",
        "definitions: {x: y + 1, y: x - 1}\n",
    ),
    Row(
        "E216", "later-parameter",
        "A parameter is made of those above it.",
        "move it below what it uses",
        "parameters: {m: 2*l, g: 9.81, l: 1}\n",
    ),
    Row(
        "E217", "not-constant",
        "The value is a number, made of parameters and `pi`.",
        "name parameters and `pi` alone",
        "simulation: {duration: theta}\n",
    ),
    Row(
        "E218", "output-only",
        "Energies, forces and constraints use what the motion is given by, not what it "
        "gives.",
        "what depends on accelerations or multipliers is for output",
        "forces: {theta: theta_ddot}\n",
    ),
    Row(
        "E219", "velocity-not-allowed",
        "What stands for a position does not depend on velocities.",
        "write it of positions, or of velocities alone",
        "constraints: {wall: {relation: theta + theta_dot >= 0, restitution: 0}}\n",
    ),
    Row(
        "E220", "no-rate",
        "What has a rate is a coordinate, or depends on positions and time alone.",
        "rates are those of coordinates and of definitions of positions and time",
        "definitions: {x: l*theta_dot, y: x_dot}\n",
    ),
    Row(
        "E221", "not-finite",
        "Numbers, energies, forces and constraints have finite values at the start, "
        "and columns of a golden all along.",
        "look for a division by 0, or for a root or a logarithm of something negative",
        "parameters: {m: 1, g: 9.81, l: 1/0}\n",
    ),
    Row(
        "E222", "not-affine",
        "A force stands along a velocity, and a slip is a velocity: sums of velocities "
        "with factors that do not depend on them.",
        "write powers of velocities into the force",
        "definitions: {y: -l*cos(theta), v2: theta_dot^2}\nforces: {v2: 1}\n",
    ),
    Row(
        "E223", "not-of-time",
        "`when` is a comparison of time and parameters.",
        "write such as `t < 0.3`",
        "constraints: {held: {relation: theta = 1, when: theta < 2}}\n",
    ),
    Row(
        "E224", "no-coordinate",
        "A constraint names a coordinate or a velocity.",
        "write what it holds: q = 1",
        "constraints: {held: m = l}\n",
    ),
    Row(
        "E225", "not-a-contact",
        "Restitution and friction belong to gaps, relations of positions with `>=` or "
        "`<=`.",
        "leave the key out",
        "constraints: {way: {relation: theta_dot >= 0, restitution: 0.5}}\n",
    ),
    Row(
        "E226", "not-one-sided",
        "Restitution and friction belong to relations with `>=` or `<=`.",
        "write the relation with `>=`, or leave the key out",
        "constraints: {held: {relation: theta = 1, restitution: 0.5}}\n",
    ),
    Row(
        "E227", "not-an-equality",
        "`limit` and `when` belong to relations with `=`.",
        "write the relation with `=`, or leave the key out",
        "constraints: {held: {relation: theta >= 0, restitution: 0, limit: 1}}\n",
    ),
    Row(
        "E228", "not-a-velocity",
        "`limit` belongs to relations of velocities.",
        "write the rates of both sides",
        "constraints: {held: {relation: theta = 1, limit: 1}}\n",
    ),
    Row(
        "E229", "not-homogeneous",
        "A one-sided relation of velocities vanishes where they do.",
        "leave out what does not depend on velocities",
        "constraints: {way: theta_dot >= 1}\n",
    ),
    Row(
        "E230", "not-a-direction",
        "A force acts along a coordinate, or along a definition of positions.",
        "name a coordinate, or a definition of what the force pushes",
        "forces: {m: 1}\n",
    ),
    Row(
        "E231", "not-a-definition",
        "Columns and reactions are asked for by the names of definitions.",
        "make a definition of it",
        "output: {columns: [theta]}\n",
    ),
    Row(
        "E232", "no-reaction",
        "A reaction belongs to a definition of positions that something is written "
        "with.",
        "name a definition that a constraint, an energy or a force uses",
        "definitions: {y: -l*cos(theta), v: theta_dot}\noutput: {reactions: [v]}\n",
    ),
    Row(
        "E233", "multiple-root",
        "A relation is written as what it sets to zero, not as a power of it.",
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
    ),
    Row(
        "E234", "expression-too-long",
        "An expression has the length that a person writes.",
        "split it into definitions",
        commands=(
            "{ printf 'forces: {theta: '; seq -s+ 300000; echo '}'; } > long.yaml",
            "lagsim check long.yaml",
        ),
    ),
)  # fmt: skip
