"""Errors of runs, of results and files, of commands and the machine."""

from __future__ import annotations

from lagsim.codes import MessageRow

_POINT = """\
coordinates: {x: {unit: m}, y: {unit: m}}
definitions: {}
initial: {x: 1, y: 0}
"""
_RUN = ("lagsim run pendulum.yaml --no-plots",)
_RUN_INTO = "lagsim run pendulum.yaml -o {} --no-plots -q"

ROWS = (
    # E5xx: a run that began and could not finish, or whose rows cannot be trusted.
    MessageRow("E501", "step-too-small",
        "The step size became too small.",
        "A step is large enough to change the time in double precision.",
        "the motion reaches a singularity (a division by zero, a singular coordinate,"
        " a force that drives a coordinate to infinity in a finite time), or it is "
        "very stiff: look at the component that the message names, end the run before"
        " that time, choose other coordinates, or use a larger rtol",
        "coordinates: {r: {unit: m}}\ndefinitions: {}\n"
        "energy: {kinetic: r_dot^2/2, potential: -1/r}\n"
        "initial: {r: 1}\nsimulation: {duration: 2}\n",
        _RUN),
    MessageRow("E502", "too-many-steps",
        "The run took too many steps.",
        "A run takes at most 10^8 steps.",
        "some part of the motion is too fast for this duration: shorten the duration, "
        "or look for a stiffness or a frequency that is too large",
        commands=()),
    MessageRow("E503", "values-not-finite",
        "An energy, a force or a constraint became infinite or not a number.",
        "Energies, forces and constraints are finite throughout the run.",
        "an energy, a force or a constraint has no finite value there (a root or a "
        "logarithm of a negative number, a division by zero, a number that is far too "
        "small or too large): check the expressions near this state",
        _POINT + "initial: {x: 1, y: 0, x_dot: 1}\n"
        "energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: y^2/2}\n"
        "forces: {y: sqrt(3 - x)}\nsimulation: {duration: 5}\n",
        (_RUN[0] + " --method rk4 --step 0.1",)),
    MessageRow("E504", "projection-failed",
        "A state could not be projected onto the constraints.",
        "Near each computed state Newton's method finds a state that satisfies the "
        "constraints.",
        "the constraints cannot all be satisfied near this state: the mechanism is at "
        "a dead point or cannot be assembled, or a fixed step is too large",
        _POINT + "energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}\n"
        "constraints: {rod: x^2 + y^2 = 1}\n",
        (_RUN[0] + " --method rk4 --step 1",)),
    MessageRow("E505", "newton-failed",
        "The equations of an implicit step could not be solved.",
        "The iteration for the equations of each implicit step converges.",
        "the motion reaches a singularity, a force jumps, or the step is too large "
        "for the curvature of the forces: look at this state",
        "coordinates: {x: {}}\ndefinitions: {}\n"
        "energy: {kinetic: x_dot^2/2, potential: -exp(x^2)}\n"
        "initial: {x: 1, x_dot: 1}\n",
        (_RUN[0] + " --method midpoint --step 0.5",)),
    MessageRow("E506", "constraint-jumps",
        "The position that a constraint prescribes, or a gap, jumped.",
        "The position that a constraint prescribes, and every gap, is a continuous "
        "function of time.",
        "the velocity that a constraint prescribes may jump, but not the position: "
        "join the pieces of the prescribed motion, or of the ground, without a step; "
        "with fixed steps, use a shorter step where bodies collide",
        _POINT + "energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}\n"
        "constraints: {belt: 'x = if(t < 0.5, 1, 2)'}\n",
        _RUN),
    MessageRow("E507", "switches-accumulate",
        "Forces switched infinitely often in a finite time.",
        "Forces and friction switch a finite number of times in a finite time.",
        "no motion continues after this time: change the forces near their switches, "
        "or end the run before it",
        """\
coordinates: {x: {}, z: {}}
definitions: {}
energy: {kinetic: (x_dot^2 + z_dot^2)/2, potential: 0}
forces: {x: "if(z_dot >= 0, -1, 1)", z: "if(x_dot >= 0, 1, -1)"}
initial: {x: 0, z: 0}
""",
        _RUN),
    MessageRow("E508", "no-answer",
        "The rows violate a constraint, or repeats of the run do not agree.",
        "The rows satisfy the constraints, and a repeat of the run has the same "
        "motion.",
        "the constraints may contradict each other from there on, or the motion may "
        "require another method: look at the model around that time, try another "
        "`--method`, or stop before it",
        "coordinates: {x: {}, y: {}, z: {}}\ndefinitions: {}\n"
        "energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 9.81*z}\n"
        "constraints: {cone: x_dot^2 + y_dot^2 = 4*z_dot^2}\n"
        "initial: {x: 0, y: 0, z: 0}\n",
        _RUN),
    MessageRow("E509", "paradox",
        "No contact forces exist that satisfy the laws of contact and friction.",
        "At every time there are contact forces that push, obey the law of friction, "
        "and keep the bodies apart.",
        "friction and inertia admit no motion from this state on (Painleve's "
        "paradox): reduce the friction, or make a body compliant; without friction, "
        "leave out a relation with `when` that follows from others",
        """\
parameters: {g: 9.81, m: 1, a: 0.5}
coordinates: {x: {}, y: {}, q: {}}
definitions: {end: x - a*cos(q)}
energy: {kinetic: m*(x_dot^2 + y_dot^2)/2 + m*a^2/6*q_dot^2, potential: m*g*y}
constraints:
  tip: {relation: y >= a*sin(q), restitution: 0, friction: 2, slip: end_dot}
  guide: {relation: q = 1, when: t < 0.1}
initial: {x: 0, q: 1, y: a*sin(q), x_dot: -3}
""",
        _RUN),
    MessageRow("E510", "state-jumps",
        "A position, or a velocity without an impact, jumped.",
        "Positions are continuous, and so are velocities except at impacts.",
        "the rows up to this time are valid. This is a bug in lagsim: please report "
        "it with the model",
        commands=()),
    MessageRow("E511", "no-reference",
        "No reference solution was found for the errors.",
        "Errors are differences from a reference solution that two computations "
        "confirm.",
        "`lagsim run` shows where the run fails; `--budget` allows more time",
        "coordinates: {r: {unit: m}}\ndefinitions: {}\n"
        "energy: {kinetic: r_dot^2/2, potential: -1/r}\n"
        "initial: {r: 1}\nsimulation: {duration: 2}\n",
        ("lagsim bench pendulum.yaml --budget 1",)),
    MessageRow("E512", "events-chatter",
        "Located events reverse each other without time passing.",
        "Some time passes before an event reverses the values that another event has "
        "set.",
        "separate the conditions (v <= 0.9 and v >= 1.1), or use an event with "
        "`every`",
        "modes: {push: 0}\nforces: {theta: 20*push}\nevents:\n"
        "  on: {at: theta_dot <= -1, set: {push: 1}}\n"
        "  off: {at: theta_dot >= -1, set: {push: 0}}\n",
        ("lagsim run pendulum.yaml --no-plots",)),
    MessageRow("E513", "table-ends",
        "The argument of a table reached the end of its points.",
        "The arguments of a table with `outside: error` stay within the range of its "
        "points.",
        "add points, set `outside` to `hold`, `extend` or `repeat`, or stop before "
        "that time",
        "tables: {torque: {points: [[0, 0], [0.5, 1]]}}\nforces: {theta: torque(t)}\n",
        _RUN),
    MessageRow("E514", "undetermined-sliders",
        "Sliders without mass slide together, and no damper resists that.",
        "Dampers that join sliders without mass are also connected to another part.",
        "connect one of the sliders by a damper, however weak, to a part that is not "
        "a slider, or give it mass",
        """\
coordinates: {x: {}, a: {}, b: {}}
definitions: {}
energy:
  kinetic: x_dot^2/2
  potential: 3*(x - a)^2/2
  dissipation: (a_dot - b_dot)^2/2
constraints:
  one: {relation: a_dot = 0, limit: 0.3}
  two: {relation: b_dot = 0, limit: 0.2}
initial: {x: 0, a: 0, b: 0, x_dot: 1}
""",
        _RUN),
    MessageRow("E520", "law-out-of-range",
        "A friction or a limit became negative, or a restitution was not from 0 to 1.",
        "Throughout the run friction and limits are not negative, and restitution is "
        "from 0 to 1.",
        "bound the expression, as in max(0, ...) or min(1, ...)",
        "coordinates: {x: {}, y: {}}\ndefinitions: {}\n"
        "energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}\n"
        "constraints:\n  floor: {relation: y >= 0, restitution: 0, friction: 0.3 - x, "
        "slip: x_dot}\n"
        "initial: {x: 0, y: 0, x_dot: 2}\n",
        _RUN),
    # E6xx: what is made of results: comparisons, goldens, pictures of several runs.
    MessageRow("E531", "no-rest",
        "No position of rest, or no steady motion, was found.",
        "The equations have a position of rest that can be found from the start of "
        "the file or from others; with `--at start` the start is at rest, or its "
        "rates are constant and do not change the equations.",
        "begin nearer to a rest, or add a spring or a constraint that holds the model",
        "energy: {kinetic: m*l^2*theta_dot^2/2, potential: 0}\n"
        "forces: {theta: 1}\n",
        ("lagsim modes pendulum.yaml",)),
    MessageRow("E601", "differs",
        "Two results differ by more than the bound.",
        "At each time each column differs by no more than its bound.",
        "begin with the column and the time that the message names first; `--plot "
        "FILE` draws the columns; if the new result is right, store it by `lagsim "
        "golden --update`",
        commands=(
            _RUN_INTO.format("one"),
            _RUN_INTO.format("other --set m=2 --set l=1.01"),
            "lagsim compare one other",
        )),
    MessageRow("E602", "bad-table",
        "A file is not a table of results.",
        "A table has a header, a column `t`, and a number in each cell.",
        "use tables that `lagsim run` has written, or their folders",
        commands=("lagsim compare pendulum.yaml pendulum.yaml",)),
    MessageRow("E603", "no-golden",
        "The model has no golden.",
        "The model has a stored result, `NAME.csv` and `NAME.json`, in the folder "
        "`golden`.",
        "`lagsim golden --update` stores a golden",
        commands=("lagsim golden pendulum.yaml",)),
    MessageRow("E604", "bad-golden",
        "The files of a golden are damaged, or do not belong together.",
        "`NAME.csv` and `NAME.json` of a golden are complete and come from one run.",
        "`lagsim golden --update` stores the golden again",
        commands=(
            "lagsim golden pendulum.yaml --update -q",
            "printf {} > golden/pendulum.json",
            "lagsim golden pendulum.yaml",
        )),
    MessageRow("E605", "incomplete",
        "The run of a golden could not finish.",
        "A golden is stored from a complete run.",
        "correct what the message names, or shorten the duration",
        "coordinates: {r: {unit: m}}\ndefinitions: {}\n"
        "energy: {kinetic: r_dot^2/2, potential: -1/r}\n"
        "initial: {r: 1}\nsimulation: {duration: 2}\n",
        ("lagsim golden pendulum.yaml --update",)),
    MessageRow("E606", "no-results",
        "A folder contains no results.",
        "The folder contains trajectory.csv and run.json, as `lagsim run` writes "
        "them.",
        "`lagsim run MODEL -o FOLDER` writes such a folder",
        commands=("lagsim overlay nowhere",)),
    MessageRow("E607", "no-column",
        "A column to be drawn is missing in a table.",
        "A column that is drawn is in each of the tables.",
        "name columns that are in all tables: --columns x",
        commands=(_RUN_INTO.format("one"), "lagsim overlay one one --columns speed")),
    MessageRow("E608", "no-spectrum",
        "A spectrum cannot be computed from this column.",
        "A spectrum needs rows at equal distances in time, with a number in each.",
        "a run with one `output_step` gives such rows",
        "simulation: {duration: 1, output_step: 0.5}\n",
        (_RUN_INTO.format("one"), "lagsim spectrum one theta")),
    MessageRow("E609", "not-json",
        "A file is not JSON.",
        "The file is work_precision.json, as `lagsim bench` writes it.",
        "give the file work_precision.json, or its folder",
        commands=(
            "printf { > work_precision.json", "lagsim bench work_precision.json",
        )),
    MessageRow("E610", "not-a-bench",
        "A JSON document is not one of `lagsim bench`.",
        "The document has the keys that `lagsim bench` writes.",
        "run `lagsim bench` again",
        commands=(
            "printf {} > work_precision.json",
            "lagsim bench work_precision.json",
        )),
    MessageRow("E611", "another-sweep",
        "The folder contains another sweep.",
        "`--resume` continues a sweep with the same model, values and options.",
        "leave --resume out to start again, or choose another folder with -o",
        commands=(
            "mkdir found; echo [] > found/sweep.rows.jsonl",
            "lagsim sweep pendulum.yaml m=1,3 -o found -q --resume",
        )),
    MessageRow("E612", "nothing-to-draw",
        "The results contain no points to animate.",
        "The model has a section `scene`, or the table has columns `x` and `y`.",
        "give the model a `scene`, or definitions `x` and `y`",
        "definitions: {}\n"
        "energy: {kinetic: m*l^2*theta_dot^2/2, potential: -m*g*l*cos(theta)}\n",
        (_RUN_INTO.format("one"), "lagsim overlay one one -o both.html")),
    MessageRow("E613", "another-run",
        "The folder contains another run.",
        "`--resume` continues a run with the same model and options, on the same "
        "machine.",
        "leave --resume out to start again, or choose another folder with -o",
        commands=(
            "mkdir out; echo kept > out/.lagsim-restart",
            "lagsim run pendulum.yaml -o out --resume",
        )),
    MessageRow("E614", "bad-points",
        "The file of `--points` contains no points.",
        "The header has a name for each column, and each row below has a finite "
        "number for each name.",
        "write a table with a header: l,theta in the first line, 1.5,0.2 below",
        commands=(
            "printf 'l,theta\\n1,0.5\\n2,half\\n' > points.csv",
            "lagsim sweep pendulum.yaml --points points.csv",
        )),
    MessageRow("E615", "bad-data",
        "The data of a fit cannot be used.",
        "The header has a column `t` and columns that the model explains. In each row"
        " below, t is not less than in the row before and lies within the run, and "
        "each other cell is a number or empty.",
        "write a table with a header: t,theta in the first line, 0.1,0.98 below",
        commands=(
            "printf 't,theta\\n0,1\\n0.5,half\\n0.4,0\\n' > data.csv",
            "lagsim fit pendulum.yaml data.csv --vary l",
        )),
    MessageRow("E616", "changes-nothing",
        "A name that a fit varies changes no column of the data.",
        "Each varied name changes a column that is matched, at the first values of all "
        "names.",
        "leave the name out, match a column that depends on it, or begin from values "
        "at which it has an effect (`--set`)",
        commands=(
            "printf 't,theta\\n0,1\\n0.5,0.2\\n1,-0.9\\n' > data.csv",
            "lagsim fit pendulum.yaml data.csv --vary m",
        )),
    # E7xx: files and folders that are written.
    MessageRow("E701", "output-folder",
        "The output folder cannot be used.",
        "The output folder can be created and written, and no other process writes "
        "into it.",
        "choose another folder",
        commands=("lagsim run pendulum.yaml -o pendulum.yaml",)),
    MessageRow("E702", "output-file",
        "The output file cannot be written.",
        "The output file can be written, and is not the model.",
        "choose another file",
        commands=("lagsim derive pendulum.yaml -o pendulum.yaml",)),
    MessageRow("E703", "exists",
        "The file exists already.",
        "`lagsim new NAME` writes NAME.yaml only if this file does not exist. `--write "
        "FILE` replaces a file only if it is a version of the model, with the same "
        "parameters, coordinates and states. `lagsim fit` does not replace its own "
        "NAME-fitted.yaml if this has been changed since.",
        "choose another name",
        commands=("lagsim new pendulum",)),
    MessageRow("E704", "unwritable",
        "The model file cannot be written.",
        "The folder of the new file exists, and you may write into it.",
        "check that the folder exists, and its permissions",
        commands=("lagsim new nowhere/pendulum",)),
    MessageRow("E705", "no-room",
        "The disk has no room for the results.",
        "The disk has room for the files that are written.",
        "make room on the disk, or choose another one with -o",
        commands=("lagsim methods > /dev/full",)),
    MessageRow("E706", "missing-package",
        "A package that an option needs is not installed.",
        "The packages that an option needs are installed.",
        "install the package that the message names, or leave the option out",
        commands=()),
    MessageRow("E707", "one-name",
        "Two models have the same name.",
        "Models that are run together have different names, and so different folders.",
        "change the `name` of one model",
        commands=(
            "cp pendulum.yaml twin.yaml",
            "lagsim run pendulum.yaml twin.yaml --no-plots",
        )),
    # E8xx: the command line.
    MessageRow("E801", "usage",
        "An argument or an option is wrong.",
        "The command has the arguments and options given, and their values are of the "
        "right type, such as --set m=2.",
        "`lagsim COMMAND --help` lists arguments and options",
        commands=("lagsim check pendulum.yaml --set m",)),
    MessageRow("E802", "unknown-template",
        "The template does not exist.",
        "The template is one of the list that `lagsim new --help` prints.",
        "`lagsim new --help` lists the templates",
        commands=("lagsim new swing --template swing",)),
    MessageRow("E803", "unknown-code",
        "No message has this number or code.",
        "A message has a number such as E104, and a code such as duplicate-key.",
        "docs/errors.md and `lagsim explain` list all messages",
        commands=("lagsim explain E999",)),
    # E9xx: lagsim itself, and the machine below it.
    MessageRow("E901", "bug",
        "lagsim stopped because of an internal error.",
        "lagsim handles every input without an internal error.",
        "this is a bug in lagsim, not in your model: please report it with the model "
        "file and the printed text",
        commands=()),
    MessageRow("E902", "failed",
        "A process ended before its result was complete.",
        "Each process that does a part of the work ends normally.",
        "run the named model alone, to see its messages",
        commands=()),
    MessageRow("E903", "starved",
        "The system has no memory or no open files left.",
        "The system has enough memory and open files.",
        "raise the limits (ulimit -v, ulimit -n, limits of a container), or start "
        "fewer runs at one time",
        commands=()),
    MessageRow("E904", "unknown-cpu",
        "`LAGSIM_CPU` names an unknown processor.",
        "`LAGSIM_CPU` names a processor that LLVM supports.",
        "leave the variable out",
        commands=("LAGSIM_CPU=abacus lagsim run pendulum.yaml --no-plots",)),
)  # fmt: skip
