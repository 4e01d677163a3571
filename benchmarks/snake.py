"""The text of a snake: links in space with joints about y and z by turns."""

TEXT = """name: snake
parameters:
  n: {n}
  l: 0.3
  c: 0.15
  m: 1
  g: 9.81
  d: 0.05
  J: [0.01, 0.012, 0.004]
  about_y(i = 1..n): mod(i + 1, 2)
coordinates: {{q(1..n): {{}}}}
frames:
  arm(0): space
  arm(i = 1..n): {{on: arm(i-1), axis: [0, about_y(i), 1 - about_y(i)], angle: q(i)}}
definitions:
  tip(0): [0, 0, 0]
  tip(i = 1..n): tip(i-1) + rotate(arm(i), vec(0, 0, l))
bodies:
  link(i = 1..n):
    mass: m
    at: tip(i-1) + rotate(arm(i), vec(0, 0, c))
    frame: arm(i)
    inertia: J
gravity: [0, 0, -g]
energy:
  kinetic: bodies
  potential: bodies
  dissipation: sum(i = 1..n, d*q_dot(i)^2/2)
initial: {{q(i = 1..n): 0.3 + 0.1*sin(i-1)}}
simulation: {{duration: {duration}, output_step: {step}}}
"""


def snake(n, duration=1.0):
    """Return the model text of n falling links, over `duration`."""
    return TEXT.format(n=n, duration=duration, step=duration / 20)
