"""Errors of a model file: its text, expressions, start and settings."""

from __future__ import annotations

from lagsim.codes.row import Row

# A mass that two coordinates hold by a rod.
_ROD = """\
coordinates: {x: {unit: m}, y: {unit: m}}
definitions: {}
energy: {kinetic: m*(x_dot^2 + y_dot^2)/2, potential: m*g*y}
constraints: {rod: x^2 + y^2 = l^2}
"""

ROWS = (
    # E1xx: files, YAML, and the sections of a model.
    Row(
        "E101", "unreadable",
        "The path is that of a file that you may read, or `-` for standard input.",
        "look at the path, and at who may read it",
        commands=("lagsim check nowhere.yaml",),
        found="The model file cannot be read.",
    ),
    Row(
        "E102", "not-utf8",
        "A model file is text in the encoding UTF-8.",
        "save the file as UTF-8",
        commands=(r"printf 'name: p\351ndulo\n' > old.yaml", "lagsim check old.yaml"),
        found="The file is not UTF-8.",
    ),
    Row(
        "E103", "empty-file",
        "A model file has at least the sections `coordinates`, `energy` and `initial`.",
        "`lagsim new NAME` writes one to begin from",
        commands=("printf '# later\\n' > empty.yaml", "lagsim check empty.yaml"),
        found="The file has no sections.",
    ),
    Row(
        "E104", "several-documents",
        "A file holds one model: no line `---` begins another.",
        "put what follows `---` into a file of its own",
        "simulation: {duration: 1}\n---\nname: another\n",
        found="The file holds more than one YAML document.",
    ),
    Row(
        "E105", "yaml-syntax",
        "Every bracket and quote is closed, and the keys of one section begin in one "
        "column.",
        "an editor that knows YAML shows where it goes wrong; `lagsim schema` gives it "
        "the keys",
        "initial: {theta: 1\n",
        found="The file is not valid YAML.",
    ),
    Row(
        "E106", "yaml-tab",
        "Lines are indented with spaces.",
        "replace tabs by spaces",
        "definitions:\n\tx: l*sin(theta)\n  y: -l*cos(theta)\n",
        found="A line is indented with a tab.",
    ),
    Row(
        "E107", "yaml-character",
        "Every character is a letter, a digit, a sign, a space or a line end.",
        "delete the character and type it again",
        "simulation: {duration: 1\x07}\n",
        found="The file has a character that cannot be seen, or that YAML does not "
        "allow.",
    ),
    Row(
        "E108", "missing-space",
        "A space follows the colon after a key: `theta: 1`.",
        "write `key: value`",
        "initial: {theta:1}\n",
        found="The space after a colon is missing.",
    ),
    Row(
        "E109", "split-by-comma",
        "Within `{}` and `[]` a comma ends a value: one that contains a comma is "
        "quoted.",
        "quote the value",
        "definitions: {x: atan2(theta, 1), y: 0}\n",
        found="A comma has ended a value too early.",
    ),
    Row(
        "E110", "too-deep",
        "Brackets and sections nest at most 100 levels deep.",
        "no section of a model needs this",
        f"initial: {{theta: {'[' * 110}{']' * 110}}}\n",
        found="Brackets or sections are nested too deep.",
    ),
    Row(
        "E111", "anchor",
        "Each value is written where it is used, without anchors.",
        "define a parameter, and use its name",
        "parameters: {m: &one 1, g: 9.81, l: 1}\n",
        found="The file has an anchor of YAML, such as `&one`.",
    ),
    Row(
        "E112", "alias",
        "Each value is written where it is used; a value that begins with `*` is an "
        "alias of YAML.",
        "quote the value if it is an expression",
        "parameters: {m: 1, g: 9.81, l: *m}\n",
        found="The file has an alias of YAML, such as `*one`.",
    ),
    Row(
        "E113", "tag",
        "A value is written without a tag: its key says whether it is a number or a "
        "text.",
        "leave the tag out, or quote the value",
        "parameters: {m: !!float 1, g: 9.81, l: 1}\n",
        found="A value has a tag of YAML, such as `!!float`.",
    ),
    Row(
        "E114", "merge-key",
        "Every entry of a section is written out in it.",
        "write the entries out",
        "initial: {<<: {theta: 1}}\n",
        found="The file has a merge key of YAML, `<<`.",
    ),
    Row(
        "E115", "complex-key",
        "A key is one word, such as `theta`, and no list or mapping.",
        "write `name: value`",
        "initial: {[theta]: 1}\n",
        found="A key is not a plain text.",
    ),
    Row(
        "E116", "duplicate-key",
        "A key appears once in its section.",
        "delete one of the two",
        "initial: {theta: 1, theta: 2}\n",
        found="A key appears twice in one section.",
    ),
    Row(
        "E117", "unknown-key",
        "A section has only keys that docs/model-file.md describes, or keys that "
        "begin with `x-`.",
        "`lagsim schema` lists all keys, and lets an editor complete them",
        "simulation: {duratoin: 1}\n",
        found="A section has an unknown key.",
    ),
    Row(
        "E118", "misplaced-key",
        "Sections begin at the left margin, and their keys are indented below them, "
        "as `duration` below `simulation:`.",
        "move it there",
        "energy: {kinetic: m*theta_dot^2/2, potential: 0, output: {}}\n",
        found="A key is in the wrong section.",
    ),
    Row(
        "E119", "missing-key",
        "A model has `coordinates`, `energy` and `initial`, a run a `duration` or an "
        "`end`, a contact a `restitution`, friction a `slip`.",
        "add the key; `lagsim new NAME` writes a model with all that is needed",
        "energy: {potential: m*g*y}\n",
        found="A key is missing that the model, the run or another key needs.",
    ),
    Row(
        "E120", "both-given",
        "Either `duration` or `end` is given, and either `lagrangian` or `kinetic` "
        "and `potential`.",
        "give one of them",
        "simulation: {duration: 1, end: 2}\n",
        found="Two keys are given that exclude each other.",
    ),
    Row(
        "E121", "not-a-mapping",
        "A section, or an entry with several properties, consists of lines `key: "
        "value`.",
        "write each entry as `key: value`, indented below the section or within `{}`",
        "initial: [1, 0]\n",
        found="A section is not a mapping.",
    ),
    Row(
        "E122", "not-a-list",
        "The value is a list in brackets, such as [x, y], even of one entry.",
        "a list is written [a, b]",
        "output: {columns: x}\n",
        found="A value is not a list.",
    ),
    Row(
        "E123", "not-a-text",
        "A name, a title, a unit or a description is a text, and no list or mapping.",
        "write one text, in quotes where it has special letters",
        "name: [pendulum]\n",
        found="A value is not a text.",
    ),
    Row(
        "E124", "not-a-truth",
        "The value is `true` or `false`.",
        "write `true` or `false`, without quotes",
        "output: {gauss: maybe}\n",
        found="A value is neither `true` nor `false`.",
    ),
    Row(
        "E125", "wrong-count",
        "A point has 2 or 3 components, a link 2 points, a `slip` 1 or 2 expressions, "
        "an axis of a plot 1 to 6.",
        "count what the message asks for",
        "scene: {points: {bob: [x]}}\n",
        found="A list has too many entries, or too few.",
    ),
    Row(
        "E126", "empty",
        "`method` and `formulation` have a name after the colon, or are left out.",
        "give a value, or leave the key out",
        "simulation: {duration: 1, method: }\n",
        found="A key has no value.",
    ),
    Row(
        "E127", "format-version",
        "The key `lagsim`, where it is given, is 1.",
        "leave `lagsim` out, or install the version of lagsim that the file asks for",
        "lagsim: 7\n",
        found="The file asks for a version of the format that this lagsim does not "
        "read.",
    ),
    Row(
        "E128", "bad-model-name",
        "A name has no slash, backslash, tab, line break or invisible letter, and is "
        "not `.` or `..`.",
        "leave out separators and invisible letters",
        "name: one/two\n",
        found="The name of the model cannot be used for a folder.",
    ),
    Row(
        "E129", "out-of-range",
        "Durations and steps are positive, tolerances and friction at least 0, "
        "restitution is from 0 to 1, and `output_step` is at most the duration.",
        "choose a number within the range that the message names",
        "simulation: {duration: -1}\n",
        found="A number is outside its range.",
    ),
    Row(
        "E130", "unknown-axis",
        "`log` names axes of its plot: x, y, and y2 where the plot has `y2`.",
        "name one of x, y, y2",
        "output: {plots: [{x: x, y: y, log: z}]}\n",
        found="`log` names an axis that the plot does not have.",
    ),
    Row(
        "E131", "duplicate-column",
        "A name appears once in `columns`.",
        "delete one of the two",
        "output: {columns: [x, x]}\n",
        found="A column is listed twice.",
    ),
    Row(
        "E132", "duplicate-reaction",
        "A name appears once in `reactions`.",
        "delete one of the two",
        "output: {reactions: [x, x]}\n",
        found="A reaction is listed twice.",
    ),
    Row(
        "E133", "more-faults",
        "The first 1000 faults of a file are shown.",
        "mend those above, and look again",
        commands=(
            "{ cat pendulum.yaml; seq -f 'key%g: 1' 1200; } > long.yaml",
            "lagsim check long.yaml 2>&1 | tail -n 4",
        ),
        found="The file has more faults than are shown.",
    ),
    Row(
        "E134", "too-many-values",
        "A file has at most 1,000,000 values, lists and mappings.",
        "tables of numbers belong into a program that calls lagsim: docs/python.md",
        commands=(
            "{ echo x-many:; yes '  - 1' | head -n 1000001; } > many.yaml",
            "lagsim check many.yaml",
        ),
        found="The file has too many values.",
    ),
    # E2xx: expressions, names and relations.
    Row(
        "E201", "expression-syntax",
        "Operators + - * / ^ stand between numbers, names and function calls, as in "
        "2*sin(theta).",
        "operators are + - * / ^, and every product is written with `*`",
        "definitions:\n  x: l*sin theta\n  y: -l*cos(theta)\n",
        found="An expression cannot be parsed.",
    ),
    Row(
        "E202", "expression-name",
        "A name is a letter, then letters, digits and `_`, such as `x_1`.",
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
        "Every `(` has its `)`.",
        "count the parentheses",
        "definitions:\n  x: l*sin(theta\n  y: -l*cos(theta)\n",
        found="A parenthesis is not closed, or was never opened.",
    ),
    Row(
        "E206", "expression-arity",
        "`atan2`, `hypot`, `min` and `max` take 2 arguments, `if` takes 3, the other "
        "functions 1.",
        "docs/model-file.md lists the functions and their arguments",
        "definitions:\n  x: l*atan2(theta)\n  y: -l*cos(theta)\n",
        found="A function has too many arguments, or too few.",
    ),
    Row(
        "E207", "expression-unknown-function",
        "A function is `sin`, `exp`, `sqrt`, `abs`, `if`, or another that "
        "docs/model-file.md lists.",
        "docs/model-file.md lists the functions; one of your own is a definition",
        "definitions:\n  x: l*sinn(theta)\n  y: -l*cos(theta)\n",
        found="An expression calls a function that does not exist.",
    ),
    Row(
        "E208", "not-an-expression",
        "The value is a number or a formula, such as 9.81 or m*g*l.",
        "write one expression, in quotes where it has a comma",
        "definitions: {x: [l, theta], y: -l*cos(theta)}\n",
        found="A value is not an expression.",
    ),
    Row(
        "E209", "unknown-name",
        "A name is `t`, `pi`, or a parameter, coordinate, definition or rate "
        "(`theta_dot`) of this model.",
        "look for a name that is spelt otherwise",
        "definitions: {x: l*sin(thta), y: -l*cos(theta)}\n",
        found="An expression uses a name that is not defined.",
    ),
    Row(
        "E210", "unknown-parameter",
        "`--set` names a parameter or a start value of the model, `--vary` a "
        "parameter.",
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
        "A name is none of `t`, `pi`, `kinetic`, `potential`, `lagrangian`, `energy`, "
        "`work`, `and`, `or`, `not`, and does not end in `_dot` or `_ddot`.",
        "choose another name",
        "parameters: {m: 1, g: 9.81, l: 1, t: 2}\n",
        found="A name is reserved.",
    ),
    Row(
        "E213", "name-clash",
        "Parameters, coordinates and definitions have different names.",
        "rename one of the two",
        "parameters: {m: 1, g: 9.81, l: 1, theta: 2}\n",
        found="One name is given to two quantities.",
    ),
    Row(
        "E214", "column-clash",
        "A name is none of the columns that constraints add, such as `lambda_rod`, "
        "`residual_rod` and `Qc_theta`.",
        "choose another name",
        "definitions: {x: l*sin(theta), y: -l*cos(theta), Qc_theta: 1}\n",
        found="A name is that of a column of the table.",
    ),
    Row(
        "E215", "cycle",
        "A definition does not use itself, neither directly nor through others.",
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
        "The value is a number: an expression of parameters and `pi` alone.",
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
        "The gap of a contact, a relation with `>=` or `<=`, depends on positions and "
        "time only.",
        "use positions only, or velocities only",
        "constraints: {wall: {relation: theta + theta_dot >= 0, restitution: 0}}\n",
        found="An expression depends on velocities, which is not allowed in its "
        "place.",
    ),
    Row(
        "E220", "no-rate",
        "`_dot` follows a coordinate, or a definition of positions and time without "
        "velocities.",
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
        "A `slip`, or a definition of velocities that a force acts on, is linear in "
        "the velocities, such as x_dot - r*phi_dot.",
        "write powers of velocities into the force",
        "definitions: {y: -l*cos(theta), v2: theta_dot^2}\nforces: {v2: 1}\n",
        found="An expression is not linear in the velocities.",
    ),
    Row(
        "E223", "not-of-time",
        "`when` compares time and parameters, such as t < 0.3.",
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
        "`restitution`, `friction` and `slip` belong to contacts: relations of "
        "positions with `>=` or `<=`.",
        "leave the key out",
        "constraints: {way: {relation: theta_dot >= 0, restitution: 0.5}}\n",
        found="A relation of velocities has a key of contacts.",
    ),
    Row(
        "E226", "not-one-sided",
        "`restitution`, `friction` and `slip` belong to relations with `>=` or `<=`.",
        "write the relation with `>=`, or leave the key out",
        "constraints: {held: {relation: theta = 1, restitution: 0.5}}\n",
        found="An equality has a key of contacts.",
    ),
    Row(
        "E227", "not-an-equality",
        "`limit` belongs to relations with `=`.",
        "write the relation with `=`, or leave the key out",
        "constraints: {held: {relation: theta >= 0, restitution: 0, limit: 1}}\n",
        found="A one-sided relation has a key of equalities.",
    ),
    Row(
        "E228", "not-a-velocity",
        "`limit` belongs to relations of velocities, such as x_dot = 0.",
        "write the rates of both sides",
        "constraints: {held: {relation: theta = 1, limit: 1}}\n",
        found="A relation of positions has a `limit`.",
    ),
    Row(
        "E229", "not-homogeneous",
        "Every term of a relation of velocities with `>=` or `<=` has a velocity as a "
        "factor, as in b_dot >= a_dot.",
        "leave out the terms without velocities",
        "constraints: {way: theta_dot >= 1}\n",
        found="A one-sided relation of velocities has a term without velocities.",
    ),
    Row(
        "E230", "not-a-direction",
        "A force acts on a coordinate, or on a definition of positions or of "
        "velocities.",
        "name a coordinate, or a definition of what the force pushes",
        "forces: {m: 1}\n",
        found="A force acts on a name along which no force can act.",
    ),
    Row(
        "E231", "not-a-definition",
        "`columns` and `reactions` list definitions, and no coordinates, parameters "
        "or rates.",
        "write a definition for it",
        "output: {columns: [theta]}\n",
        found="A listed name is not a definition.",
    ),
    Row(
        "E232", "no-reaction",
        "`reactions` lists definitions of positions and time, without velocities.",
        "name a definition that a constraint, an energy or a force uses",
        "definitions: {y: -l*cos(theta), v: theta_dot}\noutput: {reactions: [v]}\n",
        found="A definition has no reaction.",
    ),
    Row(
        "E233", "multiple-root",
        "In a model with `reactions` no relation is a power: x = 0 is written, not "
        "x^2 = 0.",
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
        "An expression has at most 1,000,000 letters.",
        "split it into definitions",
        commands=(
            "{ printf 'forces: {theta: '; seq -s+ 300000; echo '}'; } > long.yaml",
            "lagsim check long.yaml",
        ),
        found="An expression is too long.",
    ),
    # E3xx: the start of a model.
    Row(
        "E301", "inadmissible",
        "The start satisfies all constraints and their time derivatives.",
        "take the nearest state that is shown, or write `{guess: ...}` for values "
        "that lagsim is to solve for",
        _ROD + "initial: {x: 1, y: 0.5}\n",
        found="The start violates a constraint, or the time derivative of one.",
    ),
    Row(
        "E302", "missing-initial",
        "`initial` has a value for each coordinate.",
        "give one, or `{guess: ...}` where constraints determine it",
        "initial: {theta_dot: 1}\n",
        found="A coordinate has no start value.",
    ),
    Row(
        "E303", "not-a-start-value",
        "Start values belong to coordinates, velocities and definitions of these, and "
        "are made of parameters and of the start values above.",
        "start a coordinate or its velocity",
        "initial: {theta: 1, m: 2}\n",
        found="A start value is given to, or uses, a name that has none.",
    ),
    Row(
        "E304", "later-initial",
        "A start value uses only start values above it.",
        "move it below what it uses",
        "initial: {theta: theta_dot, theta_dot: 1}\n",
        found="A start value uses one that is given below it.",
    ),
    Row(
        "E305", "not-a-guess",
        "`{guess: ...}` is given for a coordinate or a velocity.",
        "guess a coordinate or a velocity, and give the definition its value",
        "initial: {theta: 1, x: {guess: 1}}\n",
        found="A guess is given for a definition.",
    ),
    Row(
        "E306", "no-inertia",
        "Each coordinate has inertia, or constraints determine its acceleration.",
        "give it mass in `kinetic`, or hold it by a constraint",
        "energy: {kinetic: 0, potential: m*g*y}\n",
        found="A coordinate has no inertia, and no constraint determines its "
        "acceleration.",
    ),
    Row(
        "E307", "negative-inertia",
        "The kinetic energy grows with speed.",
        "look for a negative mass or a wrong sign in `kinetic`",
        "energy: {kinetic: -m*l^2*theta_dot^2/2, potential: m*g*y}\n",
        found="The kinetic energy falls as a speed grows.",
    ),
    Row(
        "E308", "no-motion",
        "From the start on, some accelerations and contact forces satisfy the "
        "equations of motion and all laws of contact.",
        "start with the bodies apart, or with less friction",
        """\
parameters: {mu: 1.4, angle: atan(0.5)}
coordinates: {x: {}, y: {}, q: {}}
definitions: {end: x - sin(q)}
energy: {kinetic: (x_dot^2 + y_dot^2 + q_dot^2/3)/2, potential: 9.81*y}
constraints:
  tip: {relation: y >= cos(q), restitution: 0, friction: mu, slip: end_dot}
initial: {x: 0, y: cos(angle), q: angle, x_dot: -1}
""",
        ("lagsim run pendulum.yaml",),
        found="No motion exists from this start on.",
    ),
    Row(
        "E309", "out-of-scale",
        "Masses, lengths and their products lie between about 1e-308 and 1e308.",
        "choose units in which masses and lengths are nearer to 1",
        "coordinates: {x: {}, y: {}}\ndefinitions: {}\n"
        "energy: {kinetic: 1e-200*x_dot^2/2 + y_dot^2/2, potential: x}\n"
        "constraints: {c: 1e300*x*y + 1e-300*y^3 = 1e154}\n"
        "initial: {x: 2, y: 1}\n",
        found="Numbers of the model are too large or too small for double precision.",
    ),
    Row(
        "E310", "singular-mass",
        "Gauss's principle takes the accelerations without constraints, for which each "
        "direction needs inertia.",
        "leave `gauss` out, or give every coordinate some mass",
        "coordinates: {theta: {unit: rad}, u: {}}\n"
        "constraints: {held: u = theta}\ninitial: {theta: 1, u: 1}\n",
        ("lagsim derive pendulum.yaml --gauss",),
        found="Gauss's principle is asked for, and the mass matrix is singular.",
    ),
    # E4xx: methods and settings of a run.
    Row(
        "E401", "unknown-method",
        "A method is one of those that `lagsim methods` lists, or `auto`.",
        "`lagsim methods` lists them",
        commands=("lagsim run pendulum.yaml --method rk5",),
        found="The method does not exist.",
    ),
    Row(
        "E402", "method-refused",
        "The method can integrate this model's forces, constraints, contacts and "
        "switches.",
        "`lagsim methods` lists what each handles; `auto` chooses one that suits",
        "forces: {theta: -theta_dot}\n",
        ("lagsim run pendulum.yaml --method kahan-li6 --step 0.01",),
        found="The method cannot integrate this model.",
    ),
    Row(
        "E403", "unknown-formulation",
        "A formulation is one of those that docs/model-file.md describes, or `auto`.",
        "leave it out: `auto` chooses one",
        "simulation: {duration: 1, formulation: exact}\n",
        found="The formulation does not exist.",
    ),
    Row(
        "E404", "formulation-refused",
        "The formulation can treat this model's contacts, limits and constraints that "
        "come and go.",
        "`auto` chooses one that suits",
        "simulation: {duration: 1, formulation: elimination}\n"
        "constraints: {wall: {relation: theta >= 0, restitution: 0.5}}\n",
        ("lagsim run pendulum.yaml",),
        found="The formulation cannot be used with this model's constraints.",
    ),
    Row(
        "E405", "adaptive-method",
        "The method has a fixed step, such as rk4: only such a step has a stability "
        "limit.",
        "use --vary to see how the work of this method changes with a parameter",
        commands=("lagsim stability pendulum.yaml --methods dop853",),
        found="A stability limit is asked for, and the method chooses its steps "
        "itself.",
    ),
    Row(
        "E406", "no-stability",
        "One set of equations holds for the whole run: no contacts, no friction, and "
        "no constraints that come and go.",
        "`lagsim bench` compares methods on such a model",
        "constraints: {wall: {relation: theta >= 0, restitution: 0.5}}\n",
        ("lagsim stability pendulum.yaml",),
        found="A stability map is asked for, and the model's equations change "
        "during the run.",
    ),
    Row(
        "E407", "too-many-rows",
        "A table has at most 10^8 rows.",
        "choose a longer `output_step`",
        "simulation: {duration: 1, output_step: 1e-12}\n",
        found="The table would have too many rows.",
    ),
    Row(
        "E408", "too-long",
        "Deriving the equations takes at most 20 s, and written out they have at most "
        "700,000 operations.",
        "couple fewer terms; `derive --format python` uses the energies as written",
        """\
definitions:
  a: sin(theta) + cos(theta)
  b: sin(a)*a + cos(a)*a + a
  c: sin(b)*b + cos(b)*b + b
  d: sin(c)*c + cos(c)*c + c
  e: sin(d)*d + cos(d)*d + d
  f: sin(e)*e + cos(e)*e + e
  y: sin(f)*f + cos(f)*f + f
""",
        ("lagsim derive pendulum.yaml",),
        found="The equations are too long to be derived.",
    ),
    Row(
        "E409", "too-large",
        "The equations of a model of usual size take at most 3,000,000 operations, and "
        "2,500,000 to derive, check and plan; a mass matrix has at most 1,000,000 "
        "entries that are not 0.",
        "put fewer velocities into one product or square of the energies, fewer "
        "factors into one product, and fewer coordinates into each constraint",
        commands=(),
        found="The equations of the model are too large.",
    ),
)  # fmt: skip
