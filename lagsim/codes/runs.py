"""E5xx: a run that began and could not finish, or whose rows bear no trust."""

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
        "Steps stay longer than what rounding takes of them.",
        "the motion runs into a singularity (a division by zero, a coordinate that "
        "loses its meaning) or is very stiff: look at the component named, stop before "
        "that time, choose other coordinates there, or loosen rtol",
        "coordinates: {r: {unit: m}}\ndefinitions: {}\n"
        "energy: {kinetic: r_dot^2/2, potential: -1/r}\n"
        "initial: {r: 1}\nsimulation: {duration: 2}\n",
        _RUN,
    ),
    Row(
        "E502", "too-many-steps",
        "A run ends within the steps that it may take.",
        "the motion has much faster parts than the run is long: shorten the duration, "
        "or look for a stiffness or a frequency that is larger than it should be",
        commands=(),
    ),
    Row(
        "E503", "values-not-finite",
        "Energies, forces and constraints have finite values on the way.",
        "an energy, a force or a constraint has no finite value there (a root or a "
        "logarithm of something negative, a division by zero): check the expressions "
        "near this state",
        _POINT + "initial: {x: 1, y: 0, x_dot: 1}\n"
        "energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: y^2/2}\n"
        "forces: {y: sqrt(3 - x)}\nsimulation: {duration: 5}\n",
        (_RUN[0] + " --method rk4 --step 0.1",),
    ),
    Row(
        "E504", "projection-failed",
        "Each state can be brought back onto the constraints.",
        "the constraints cannot all be met near this state: the mechanism is at a dead "
        "point or taken apart, or a fixed step is too large",
        _POINT + "energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}\n"
        "constraints: {rod: x^2 + y^2 = 1}\n",
        (_RUN[0] + " --method rk4 --step 1",),
    ),
    Row(
        "E505", "newton-failed",
        "The equations of an implicit step have a solution near its start.",
        "the motion runs into a singularity there, a force jumps, or a step is too "
        "large for how strongly the forces bend: look at this state",
        "coordinates: {x: {}}\ndefinitions: {}\n"
        "energy: {kinetic: x_dot^2/2, potential: -exp(x^2)}\n"
        "initial: {x: 1, x_dot: 1}\n",
        (_RUN[0] + " --method midpoint --step 0.5",),
    ),
    Row(
        "E506", "constraint-jumps",
        "What a moving constraint asks for does not jump.",
        "a moving constraint may change its speed at once, not its position: join the "
        "pieces of its motion",
        _POINT + "energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}\n"
        "constraints: {belt: 'x = if(t < 0.5, 1, 2)'}\n",
        _RUN,
    ),
    Row(
        "E507", "switches-accumulate",
        "The times at which forces switch do not crowd together without an end.",
        "no motion leads on from there: change the forces near their switches, or stop "
        "before that time",
        """\
coordinates: {x: {}, z: {}}
definitions: {}
energy: {kinetic: (x_dot^2 + z_dot^2)/2, potential: 0}
forces: {x: -sign(z_dot), z: sign(x_dot)}
initial: {x: 0, z: 0}
""",
        _RUN,
    ),
    Row(
        "E508", "no-answer",
        "The rows meet the constraints, and a repeat gives the same motion.",
        "the constraints contradict each other from there on, or no method follows the "
        "motion through what happens there: look at the scene around that time, or "
        "stop before it",
        "coordinates: {x: {}, y: {}, z: {}}\ndefinitions: {}\n"
        "energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 9.81*z}\n"
        "constraints: {cone: x_dot^2 + y_dot^2 = 4*z_dot^2}\n"
        "initial: {x: 0, y: 0, z: 0}\n",
        _RUN,
    ),
    Row(
        "E509", "paradox",
        "Contacts have forces that hold them.",
        "friction and the bodies' inertia leave no motion there (Painleve): less "
        "friction, or a body that yields a little, would",
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
    ),
    Row(
        "E510", "state-jumps",
        "Positions go on from where they are, and so do velocities but at impacts.",
        "positions never jump, and velocities only at an impact: the rows up to there "
        "stand. This is a fault of lagsim's: please report the model",
        commands=(),
    ),
    Row(
        "E511", "no-reference",
        "Work and error are measured against a motion that two ways agree on.",
        "`lagsim run` says where it fails; `--budget` gives it more time",
        "coordinates: {r: {unit: m}}\ndefinitions: {}\n"
        "energy: {kinetic: r_dot^2/2, potential: -1/r}\n"
        "initial: {r: 1}\nsimulation: {duration: 2}\n",
        ("lagsim bench pendulum.yaml --budget 1",),
    ),
)  # fmt: skip
