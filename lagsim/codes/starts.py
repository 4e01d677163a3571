"""E3xx: the start of a model."""

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
        "Each coordinate has a start value.",
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
        "Only coordinates and velocities are guessed.",
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
        "Forces, impacts and friction allow a motion from the start on.",
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
        "The numbers of a model are within the range of double precision.",
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
)  # fmt: skip
