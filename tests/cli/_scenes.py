"""Models of a few lines."""

PENDULUM = """\
parameters: {l: 1, g: 9.8}
coordinates: {theta: {unit: rad}}
energy: {kinetic: l^2*theta_dot^2/2, potential: -g*l*cos(theta)}
initial: {theta: 1}
simulation: {duration: 2, output_step: 0.1}
"""

# The notes' elastic pendulum on a curve; `START` is its start.
CURVE = """\
parameters: {l: 1, g: 9.8, K: 25.6, M: 1}
coordinates: {theta: {unit: rad}, u: {unit: m}}
definitions: {x: (l + u)*sin(theta), y: -(l + u)*cos(theta)}
energy:
  kinetic: M*(x_dot^2 + y_dot^2)/2
  potential: M*g*(l + y) + K*u^2/2
constraints: {path: u = l - l*theta^2}
initial: {theta: 1, u: START}
simulation: {duration: 1, output_step: 0.05}
"""
ON_THE_CURVE = CURVE.replace("START", "l - l*theta^2")
CAPTION = CURVE.replace("START", "l")

# Falls into the centre at t = pi/(2 sqrt 2) = 1.1107.
FALL = """\
coordinates: {r: {unit: m}}
energy: {kinetic: r_dot^2/2, potential: -1/r}
initial: {r: 1}
simulation: {duration: 2, output_step: 0.01}
"""

CONTACT = """\
coordinates: {x: , y: }
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.8*y}
constraints: {floor: {relation: y >= 0, restitution: 0.5}}
initial: {x: 0, y: 1}
simulation: {duration: 1}
"""

# For how long, it does not say.
TIMELESS = CONTACT.replace("simulation: {duration: 1}\n", "")

# Longer than anyone waits.
ENDLESS = PENDULUM.replace(
    "duration: 2, output_step: 0.1", "duration: 1e7, output_step: 1"
)
