"""E5xx: a run that began and could not finish, or whose rows cannot be trusted."""

from __future__ import annotations

from lagsim.codes.row import Row

_POINT = """\
coordinates: {x: {unit: m}, y: {unit: m}}
definitions: {}
initial: {x: 1, y: 0}
"""
_RUN = ("lagsim run pendulum.yaml --no-plots",)

ROWS = (
    Row(
        "E501", "step-too-small",
        "The step size stays above the limit that rounding sets.",
        "the motion runs into a singularity (a division by zero, a coordinate that "
        "loses its meaning) or is very stiff: look at the component named, stop before "
        "that time, choose other coordinates there, or loosen rtol",
        "coordinates: {r: {unit: m}}\ndefinitions: {}\n"
        "energy: {kinetic: r_dot^2/2, potential: -1/r}\n"
        "initial: {r: 1}\nsimulation: {duration: 2}\n",
        _RUN,
        found="The step size became too small.",
    ),
    Row(
        "E502", "too-many-steps",
        "A run ends within the allowed number of steps.",
        "the motion has much faster parts than the run is long: shorten the duration, "
        "or look for a stiffness or a frequency that is larger than it should be",
        commands=(),
        found="The run took too many steps.",
    ),
    Row(
        "E503", "values-not-finite",
        "Energies, forces and constraints are finite throughout the run.",
        "an energy, a force or a constraint has no finite value there (a root or a "
        "logarithm of something negative, a division by zero, a number that is "
        "far too small or too large): check the expressions near this state",
        _POINT + "initial: {x: 1, y: 0, x_dot: 1}\n"
        "energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: y^2/2}\n"
        "forces: {y: sqrt(3 - x)}\nsimulation: {duration: 5}\n",
        (_RUN[0] + " --method rk4 --step 0.1",),
        found="An energy, a force or a constraint became infinite or not a number.",
    ),
    Row(
        "E504", "projection-failed",
        "Each state can be projected onto the constraints.",
        "the constraints cannot all be satisfied near this state: the mechanism is at "
        "a dead point or cannot be assembled, or a fixed step is too large",
        _POINT + "energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}\n"
        "constraints: {rod: x^2 + y^2 = 1}\n",
        (_RUN[0] + " --method rk4 --step 1",),
        found="A state could not be projected onto the constraints.",
    ),
    Row(
        "E505", "newton-failed",
        "The equations of an implicit step have a solution near its start.",
        "the motion runs into a singularity there, a force jumps, or a step is too "
        "large for forces as nonlinear as these: look at this state",
        "coordinates: {x: {}}\ndefinitions: {}\n"
        "energy: {kinetic: x_dot^2/2, potential: -exp(x^2)}\n"
        "initial: {x: 1, x_dot: 1}\n",
        (_RUN[0] + " --method midpoint --step 0.5",),
        found="The equations of an implicit step could not be solved.",
    ),
    Row(
        "E506", "constraint-jumps",
        "The position that a constraint prescribes, and a gap, is continuous.",
        "a constraint, or a gap, may change its speed abruptly, not its position: join "
        "the pieces of its motion, or of the ground",
        _POINT + "energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}\n"
        "constraints: {belt: 'x = if(t < 0.5, 1, 2)'}\n",
        _RUN,
        found="The position that a constraint prescribes, or a gap, jumped.",
    ),
    Row(
        "E507", "switches-accumulate",
        "The times at which forces switch do not accumulate.",
        "no motion continues from there: change the forces near their switches, or "
        "stop before that time",
        """\
coordinates: {x: {}, z: {}}
definitions: {}
energy: {kinetic: (x_dot^2 + z_dot^2)/2, potential: 0}
forces: {x: "if(z_dot >= 0, -1, 1)", z: "if(x_dot >= 0, 1, -1)"}
initial: {x: 0, z: 0}
""",
        _RUN,
        found="Forces switched infinitely often within a finite time.",
    ),
    Row(
        "E508", "no-answer",
        "The rows satisfy the constraints, and a repeat gives the same motion.",
        "no method can integrate the motion past that time, or its constraints "
        "contradict each other from there on: look at the model around that time, or "
        "stop before it",
        "coordinates: {x: {}, y: {}, z: {}}\ndefinitions: {}\n"
        "energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 9.81*z}\n"
        "constraints: {cone: x_dot^2 + y_dot^2 = 4*z_dot^2}\n"
        "initial: {x: 0, y: 0, z: 0}\n",
        _RUN,
        found="The rows violate a constraint, or repeats of the run do not agree.",
    ),
    Row(
        "E509", "paradox",
        "Contact forces exist that satisfy all contact laws.",
        "friction and the bodies' inertia allow no motion there (Painleve's paradox): "
        "reduce the friction, or let a body yield a little",
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
        _RUN,
        found="No contact forces exist that satisfy the laws of contact and friction.",
    ),
    Row(
        "E510", "state-jumps",
        "Positions are continuous, and so are velocities except at impacts.",
        "positions never jump, and velocities only at an impact: the rows up to there "
        "are valid. This is a fault of lagsim's: please report the model",
        commands=(),
        found="A position, or a velocity without an impact, jumped.",
    ),
    Row(
        "E511", "no-reference",
        "Errors are measured against a reference that two computations agree on.",
        "`lagsim run` shows where it fails; `--budget` allows more time",
        "coordinates: {r: {unit: m}}\ndefinitions: {}\n"
        "energy: {kinetic: r_dot^2/2, potential: -1/r}\n"
        "initial: {r: 1}\nsimulation: {duration: 2}\n",
        ("lagsim bench pendulum.yaml --budget 1",),
        found="No reference solution was found to measure errors against.",
    ),
)  # fmt: skip
