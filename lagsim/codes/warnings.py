"""W1xx: of a model and its start; W2xx: of settings; W3xx: of a motion; W4xx: files."""

from __future__ import annotations

from lagsim.codes import MODEL, PAINLEVE, PLANE, warning

_RUN = ("lagsim run pendulum.yaml --no-plots",)
_OSCILLATOR = "lagsim run models/failing/oscillator.yaml --no-plots "

ROWS = (
    warning("W101", "unused-parameter",
        "A parameter is not used in any expression.",
        "check the spelling of its name, or delete the parameter",
        "parameters: {m: 1, g: 9.81, l: 1, length: 2}\n"),
    warning("W102", "degrees",
        "A quantity in `deg`, or a number of degrees such as 60, is the argument of "
        "`sin`, `cos` or `tan`, which is in radians.",
        "write theta*pi/180 there",
        "coordinates: {theta: {unit: deg}}\n"),
    warning("W103", "rough-start",
        "The start was rounded, and satisfies the constraints only approximately.",
        "write the start value as the expression that the message shows",
        PLANE + "constraints: {rod: x^2 + y^2 = l^2}\n"
        "initial: {x: 0.8, y: -0.6000001}\n"),
    warning("W104", "redundant",
        "A constraint follows from others.",
        "leave the constraint out; the motion does not change",
        PLANE + "constraints: {one: x = y, other: 2*x = 2*y}\n"
        "initial: {x: 1, y: 1}\n"),
    warning("W105", "multipliers-not-unique",
        "Constraints are redundant: their multipliers are not unique, and the "
        "multipliers of least norm are reported.",
        "leave out constraints until the remaining ones determine their multipliers",
        PLANE + "constraints: {one: x = y, other: 2*x = 2*y}\n"
        "initial: {x: 1, y: 1}\n"),
    warning("W106", "vanishing-gradient",
        "The gradient of a constraint vanishes at the start.",
        "start elsewhere, or write the constraint in another form",
        PLANE + "constraints: {cross: x*y = 0}\ninitial: {x: 0, y: 0}\n"),
    warning("W107", "multiple-root",
        "A relation is a power, whose gradient is 0 wherever the relation is "
        "satisfied: the simple root is used instead.",
        "take the root of both sides",
        PLANE + "constraints: {line: (x - y)^2 = 0}\ninitial: {x: 1, y: 1}\n"),
    warning("W108", "double-root",
        "A guess is at a double root of the constraints.",
        "guess another value, or write the constraint so that its root is simple",
        PLANE + "constraints: {curve: y^3 = (x - 1)^2*(x + 2), line: x = 1}\n"
        "initial: {x: {guess: 1.1}, y: {guess: 0.1}}\n"),
    warning("W109", "other-roots",
        "The guesses have other solutions than the one used.",
        "choose a guess nearer to the intended solution",
        PLANE + "constraints: {rod: x^2 + y^2 = l^2}\n"
        "initial: {x: 0.8, y: {guess: 0.01}}\n"),
    warning("W110", "undetermined-guess",
        "No equation determines a guess: it stays as given.",
        "state it as a value",
        "initial: {theta: {guess: 1}}\n"),
    warning("W111", "painleve",
        "Friction laws contradict each other at the start (Painlevé's paradox): `run` "
        "refuses the model.",
        "reduce the friction, or make a body compliant",
        PAINLEVE),
    warning("W112", "reaction-zero",
        "No energy, force or constraint uses a definition in `reactions`: its "
        "reaction is 0.",
        "list definitions that energies, forces or constraints use",
        "output: {reactions: [x]}\n"),
    warning("W113", "unit-mismatch",
        "Units are inconsistent: of two terms of a sum, of the two sides of a "
        "relation or a comparison, of the argument of a function, of energies, of a "
        "force, or of a value and its own unit.",
        "correct the expression or the unit; numbers are never scaled: mm is not "
        "consistent with m",
        "parameters: {m: 1, g: 9.81, l: {value: 1, unit: m}}\n"
        "definitions:\n  x: l + theta\n  y: -l*cos(theta)\n"),
    warning("W120", "no-effect",
        "Bodies or gravity are given, but the energies do not contain the word "
        "`bodies`.",
        "write the word `bodies` in `kinetic` and in `potential`",
        "gravity: [0, -g]\nbodies: {bob: {mass: m, at: [x, y]}}\n"),
    warning("W201", "start-changed",
        "The run starts from the nearest exact state.",
        "write the start that `lagsim check --repair` shows",
        PLANE + "constraints: {rod: x^2 + y^2 = l^2}\n"
        "initial: {x: 0.8, y: -0.6000001}\n",
        _RUN),
    warning("W202", "step-unused",
        "`step` has no effect: only methods with a fixed step use it.",
        "leave it out, or choose a method with a fixed step",
        "simulation: {duration: 1, step: 0.01}\n",
        _RUN),
    warning("W203", "tolerance-unused",
        "Tolerances have no effect: only methods with step control use tolerances.",
        "leave the tolerances out, or choose a method with step control",
        commands=(_RUN[0] + " --method rk4 --step 0.001 --rtol 1e-9",)),
    warning("W204", "gain-unused",
        "`gain` has no effect: only the formulation `baumgarte` uses it.",
        "leave it out, or choose `formulation: baumgarte`",
        "simulation: {duration: 1, gain: 10}\n",
        _RUN),
    warning("W206", "option-unused",
        "An option of a method has no effect: the method of the run does not have "
        "this option.",
        "leave the option out, or choose the method that `lagsim run --help` names "
        "for it",
        "simulation: {duration: 1, spectral_radius: 0.8}\n",
        _RUN),
    warning("W207", "retired",
        "The file or the command names a retired method or formulation of an earlier "
        "version: `auto` takes its place.",
        "leave the key or the option out",
        "simulation: {duration: 1, method: exponential}\n", _RUN),
    warning("W301", "horizon",
        "After this time the estimated error exceeds 0.1 of a coordinate's range.",
        "end the run there, or use averages and bounds, which remain reliable in "
        "chaos",
        commands=("lagsim run models/failing/chaos.yaml --no-plots",)),
    warning("W302", "end-in-doubt",
        "A repeat of the run ends differently.",
        "use a smaller tolerance, or look at the model around that time",
        commands=(
            _RUN[0].replace(MODEL, "models/failing/cubic-well.yaml")
            + " --method verlet --step 1.7320508",
        )),
    warning("W303", "constraint-not-held",
        "Rows violate the constraints by more than 1e-6 of their scale.",
        "use `--formulation projection`, or `auto`",
        commands=(
            _RUN[0].replace(MODEL, "models/failing/rod.yaml")
            + " --formulation drift --method rk4 --step 0.01",
        )),
    warning("W304", "energy-gained",
        "energy - work of a decoupled group of bodies grew by more than 0.1 % of its "
        "energy in play.",
        "use a shorter step, a smaller tolerance, or `auto`",
        commands=(_OSCILLATOR + "--method euler --step 0.01",)),
    warning("W305", "energy-lost",
        "energy - work of a decoupled group of bodies fell by more than 0.1 % of its "
        "energy in play.",
        "use a shorter step, a smaller tolerance, or `auto`",
        commands=(_OSCILLATOR + "--method rk4 --step 1",)),
    warning("W306", "step-at-stability-bound",
        "Stability, not accuracy, limits the step, and the step is near that limit or "
        "beyond it.",
        "use the step that is named, or a method for stiff motion: radau",
        commands=(_OSCILLATOR + "--method rk4 --step 2.9 --duration 50",)),
    warning("W307", "fast-mode-damped",
        "The method removes energy from a fast oscillation.",
        "use a shorter step or a smaller tolerance, or replace the oscillating part "
        "by a constraint",
        commands=(
            _RUN[0].replace(MODEL, "models/failing/stiff-spring.yaml")
            + " --set l0=1e-4 --method generalized-alpha --step 1e-4",
        )),
    warning("W308", "nearly-dependent",
        "Constraints became nearly dependent; from then on their equations are solved "
        "by a QR decomposition.",
        "look at the mechanism around that time; other coordinates may avoid it",
        commands=(
            "lagsim run models/failing/parallelogram.yaml --no-plots --rtol 1e-11",
        )),
    warning("W309", "rank",
        "Constraints became dependent: a singular configuration.",
        "the motion may branch there: use one coordinate fewer to select a branch",
        commands=("lagsim run models/failing/parallelogram.yaml --no-plots",)),
    warning("W310", "coordinate-singularity",
        "The inertia of a coordinate nearly vanished during the run.",
        "choose coordinates whose pole lies elsewhere",
        commands=("lagsim run models/failing/polar-miss.yaml --no-plots",)),
    warning("W311", "impact-order",
        "Several contacts were struck at one time, and the result depends on the "
        "order of the impacts: they are treated as simultaneous.",
        "add the small gaps, or the springs, that the real bodies have",
        commands=("lagsim run models/failing/balls-in-a-row.yaml --no-plots",)),
    warning("W312", "impact-energy",
        "An impact increased the energy: restitution together with friction can do "
        "this.",
        "reduce restitution or friction there",
        """\
parameters: {a: 0.5}
coordinates: {x: {}, y: {}, q: {}}
definitions: {end: x - a*cos(q)}
energy: {kinetic: (x_dot^2 + y_dot^2)/2 + a^2/6*q_dot^2, potential: 0}
constraints:
  tip: {relation: y >= a*sin(q), restitution: 1, friction: 1, slip: end_dot}
initial: {x: 0, q: 0.8, y: a*sin(q) + 0.47, x_dot: 0.1, y_dot: -2}
""",
        _RUN),
    warning("W313", "shared-contact",
        "Contacts are redundant: their forces are not unique, and one solution is "
        "used. The motion is unique.",
        "remove contacts until the forces of the remaining ones are unique",
        """\
coordinates: {z: {}, a: {}, b: {}}
definitions: {}
energy: {kinetic: (z_dot^2 + a_dot^2 + b_dot^2)/2, potential: 9.81*z}
constraints:
  one: {relation: z + a + b >= 0, restitution: 0}
  two: {relation: z + a - b >= 0, restitution: 0}
  three: {relation: z - a + b >= 0, restitution: 0}
  four: {relation: z - a - b >= 0, restitution: 0}
initial: {z: 0, a: 0, b: 0}
simulation: {duration: 0.1, output_step: 0.1}
""",
        _RUN),
    warning("W314", "unsettled-impulses",
        "The relaxation of `moreau` did not converge in a step: contacts are "
        "satisfied only approximately.",
        "use a shorter step, or a method that locates impacts",
        commands=()),
    warning("W315", "unresolved-switch",
        "More than one motion from a switch of the forces is possible.",
        "define the forces at the switch itself, or start away from it",
        "coordinates: {x: {}}\ndefinitions: {push: 'if(x_dot >= 0, 1, -1)'}\n"
        "energy: {kinetic: x_dot^2/2, potential: 0}\nforces: {x: push}\n"
        "initial: {x: 0}\n",
        _RUN),
    warning("W317", "events-unlisted",
        "More events happened than run.json lists: `event_counts` counts all.",
        "end the run earlier, or count the events of interest in the table; give more "
        "mass to a part that is so light that it hops or chatters at each step, or "
        "leave it out",
        commands=()),
    warning("W318", "error-unknown",
        "The error is not known: the repeat that estimates it failed.",
        "look at the model where the repeat failed, or try another method or rtol",
        commands=()),
    warning("W319", "energy-drifts",
        "energy - work, which is constant, changed by more than the larger of 1e-6 and "
        "1000 `rtol`, both relative to the energy in play (the largest of the kinetic "
        "energy and of the ranges of potential energy and work).",
        "choose an origin and a frame near the moving bodies; or use differences as "
        "coordinates",
        """\
coordinates: {x: {}, y: {}, u: {}, v: {}}
definitions: {}
energy:
  kinetic: (x_dot^2 + y_dot^2 + u_dot^2 + v_dot^2)/2
  potential: -1/hypot(u - x, v - y)
initial: {x: 1e9 - 0.5, y: 0, u: 1e9 + 0.5, v: 0, y_dot: -0.7, v_dot: 0.7}
simulation: {duration: 1000, output_step: 5}
""",
        _RUN),
    warning("W320", "column-not-finite",
        "A column of the table has values that are not finite (inf or nan).",
        "choose units in which the numbers are nearer to 1, or check the divisors in "
        "the expression of the column from that time on",
        "energy: {kinetic: m*l^2*theta_dot^2/2, potential: 1e300*g*theta}\n",
        _RUN),
    warning("W321", "shared-friction",
        "Sliding friction depends on normal forces that are not unique, so the motion "
        "is not unique.",
        "leave out contacts, or constraints beside the contacts, until the remaining "
        "ones determine their forces; or use one coefficient of friction for all "
        "contacts",
        """\
coordinates: {x: {}, y: {}}
definitions: {}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
constraints:
  one: {relation: y >= 0, restitution: 0, friction: 0.1, slip: x_dot}
  two: {relation: y >= 0, restitution: 0, friction: 0.5, slip: x_dot}
initial: {x: 0, y: 0, x_dot: 3}
simulation: {duration: 0.1, output_step: 0.1}
""",
        _RUN),
    warning("W323", "not-differentiable",
        "The motion is not differentiable by a name in some rows: an event crosses the "
        "time of the row, or the sequence of events changes. The derivatives in these "
        "rows are left empty.",
        "choose an `output_step` with which no row lies at an event",
        """\
parameters: {g: 9.81, h: g/8}
coordinates: {y: {}}
definitions: {}
energy: {kinetic: y_dot^2/2, potential: g*y}
constraints: {floor: {relation: y >= 0, restitution: 0.5}}
initial: {y: h}
output: {sensitivities: [h]}
simulation: {duration: 1, output_step: 0.25}
""",
        _RUN),
    warning("W324", "not-identifiable",
        "The data of a fit do not determine some of its names: these can change "
        "together with no effect on the matched columns.",
        "leave one of the names at a known value, or measure a quantity that depends "
        "on each of these names",
        commands=(
            "printf 't,theta\\n0,1\\n0.5,0.2\\n1,-0.9\\n' > data.csv",
            "lagsim fit pendulum.yaml data.csv --vary l --vary g --no-plots",
        )),
    warning("W325", "residual-pattern",
        "Successive residuals of a fit are correlated, as measurement noise is not: "
        "with the values found the model does not explain the data. Other starts have "
        "been tried.",
        "look at the residuals in fit.png; `--starts 20` or bounds such as "
        "`--vary k=1:100` search farther; where all starts lead to these values the "
        "model lacks an effect, and the intervals are too narrow",
        commands=(
            "(echo t,theta; seq 0 0.05 1 | sed 's/$/,0.5/') > data.csv",
            "lagsim fit pendulum.yaml data.csv --vary l --no-plots",
        )),
    warning("W401", "nothing-to-draw",
        "`--animate` found neither a section `scene` nor definitions `x` and `y`: no "
        "page is written.",
        "give the model a `scene`",
        "definitions: {}\n"
        "energy: {kinetic: m*l^2*theta_dot^2/2, potential: -m*g*l*cos(theta)}\n",
        (_RUN[0] + " --animate",)),
    warning("W402", "result-replaced",
        "The default folder contained a result of other parameters or options, or of "
        "another file, which this run has replaced.",
        "name folders with -o to keep both",
        commands=(_RUN[0] + " -q", _RUN[0] + " --set m=2")),
    warning("W403", "not-drawn",
        "A picture, or the page, could not be drawn. The table and run.json are "
        "complete.",
        "this is a bug in lagsim: please report it with the model",
        commands=()),
    warning("W404", "not-locked",
        "The file system of the output folder has no locks. Another run that writes "
        "into the folder at the same time is not noticed.",
        "write into one folder with one run at a time, or choose a folder on another "
        "file system",
        commands=()),
    warning("W405", "few-rows",
        "Fewer than 50 rows of a motion are compared with its golden: after an early "
        "horizon rounding errors determine the motion.",
        "use a smaller `output_step`, or a shorter `duration`",
        """\
coordinates: {a: {}, b: {}}
definitions: {}
energy:
  kinetic: m*l^2*(a_dot^2 + b_dot^2/2 + a_dot*b_dot*cos(a - b))
  potential: -m*g*l*(2*cos(a) + cos(b))
initial: {a: 2, b: 1}
simulation: {duration: 100, output_step: 1}
""",
        (f"lagsim golden {MODEL} --update",)),
    warning("W406", "change-unseen",
        "A small change of a number of the model (of a parameter by 1e-4 of its value, "
        "of a start value by 1e-5, of a point of a table by 1 % of the range) moves "
        "the motion by more than rounding, yet no stored row of the golden leaves its "
        "bound: the golden would not detect such a change.",
        "use a smaller `output_step`, so that rows lie where the motion responds; or "
        "add `definitions` as columns that respond",
        """\
parameters: {m: 1, g: 9.81, l: 1, pulse: 1}
states: {s: {rate: "100*(if(t > 0.2 and t < 0.3, pulse, 0) - s)"}}
initial: {theta: 1, s: 0}
simulation: {duration: 2, output_step: 0.5}
""",
        (f"lagsim golden {MODEL} --update",)),
    warning("W407", "frozen-time",
        "The equations depend on time: positions of rest and modes are computed at "
        "the time of the start, with moving constraints frozen.",
        "set the amplitudes of the terms that depend on time to 0 by `--set`, or "
        "choose a `start` at which these terms vanish",
        "forces: {theta: sin(t)}\n",
        ("lagsim modes pendulum.yaml --no-plots",)),
    warning("W408", "no-response",
        "A parameter that is the input of a frequency response moves neither a state "
        "nor an output at the state of the study.",
        "name an entry of `forces`, or choose a state or a time at which the parameter "
        "acts",
        commands=("lagsim modes pendulum.yaml --response m:theta --no-plots",)),
    warning("W409", "not-linear",
        "The motion about a rest, or about a steady motion, is not linear, however "
        "small it is: the equations of both sides of a switch differ there, or a law "
        "(a contact, a freewheel, friction, a limit) has its multiplier at its bound. "
        "The eigenvalues and modes belong to the side, or the assumption, that the "
        "message names.",
        "shift the start, so that the motion stays on one side, or load the contact; "
        "for frequencies of both sides together, `run` the motion from a start "
        "beside the rest",
        "forces: {theta: -3*max(theta, 0)}\n",
        ("lagsim modes pendulum.yaml --no-plots",)),
)  # fmt: skip
