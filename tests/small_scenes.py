"""Small scenes as text, their exact solutions, and the times of their rows."""

import itertools
import math
import re

import numpy as np
from scipy.special import ellipj, ellipk

_OSCILLATOR = """
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: x^2/2}}
{forces}
initial: {{x: {x}, x_dot: {v}}}
{simulation}
"""
_SPRING = """\
parameters: {{{parameters}}}
coordinates: {{x: {{{unit}}}}}
energy: {{kinetic: x_dot^2/2, potential: k*x^2/2}}
initial: {{x: {x}}}
{simulation}
"""
# A power is a form: what is localized in it, and whether the motion is linear.
_POWER = """\
parameters: {{n: 2}}
coordinates: {{x: }}
energy: {{kinetic: x_dot^2/2, potential: abs(x)^n/n}}
initial: {{x: 1}}
{simulation}
"""
_ORBIT = """\
parameters: {{mu: 1}}
coordinates: {{r: , phi: }}
energy: {{kinetic: r_dot^2/2 + r^2*phi_dot^2/2, potential: -mu/r}}
initial: {{r: 1, phi: 0, phi_dot: 1}}
{simulation}
"""
_ELASTIC = """
parameters: {{l: 1, g: 9.8, K: {K}}}
coordinates: {{theta: {{}}, u: {{}}}}
energy:
  kinetic: ((l + u)*theta_dot)^2/2 + u_dot^2/2
  potential: g*(l - (l + u)*cos(theta)) + K*u^2/2
initial: {{{initial}}}
{simulation}
"""
# Length and gravity 1, let go at rest: in its angle, and on a rod.
_PENDULUM = """
coordinates: {{a: {{}}}}
energy: {{kinetic: a_dot^2/2, potential: -cos(a)}}
initial: {{a: {amplitude}}}
{simulation}
"""
_HELD = """
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: y}}
constraints: {{rod: x^2 + y^2 = 1}}
initial: {{x: sin({amplitude}), y: -cos({amplitude})}}
{simulation}
"""
_FALL = """
parameters: {{g: 9.81, h: 2.5}}
coordinates: {{y: {{}}}}
energy: {{kinetic: y_dot^2/2, potential: g*y}}
initial: {{y: {y}, y_dot: {v}}}
simulation: {{duration: {duration}, output_step: 0.1, until: "{until}"{more}}}
"""

_BALL = """
parameters: {{e: {e}, g: {g}, h: {h}}}
coordinates: {{y: {{}}}}
energy: {{kinetic: y_dot^2/2, potential: g*y}}
constraints: {{floor: {{relation: y >= 0, restitution: e}}}}
initial: {{y: h}}
{simulation}
"""

# Named scenes of commands.
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

# Of a clock beside rows whose angle falls to nothing at x = 1.1.
NEARLY = """
coordinates: {x: {}, y: {}, z: {}, clock: {}}
energy:
  kinetic: (x_dot^2 + y_dot^2 + z_dot^2 + clock_dot^2)/2
  potential: 200*clock^2
constraints:
  plane: z = 0
  tilted: "z = (1.1 - x)*y"
initial: {x: 0, y: 0, z: 0, x_dot: 1, clock: 1}
simulation: {duration: DURATION, output_step: 0.01METHOD}
"""


def oscillator(simulation=None, *, x=1, v=0, force=None):
    """x'' = -x: x cos(t) + v sin(t)."""
    forces = f'forces: {{x: "{force}"}}' if force else ""
    return _OSCILLATOR.format(simulation=line(simulation), x=x, v=v, forces=forces)


def spring(simulation=None, *, parameters="k: 4", unit="", x=1):
    """x'' = -k x from rest: x cos(sqrt(k) t)."""
    return _SPRING.format(
        simulation=line(simulation), parameters=parameters, unit=unit, x=x
    )


def elastic_pendulum(initial, simulation=None, *, K=25.6):
    """Pendulum in its angle theta and the stretch u of its spring of stiffness K."""
    return _ELASTIC.format(initial=initial, simulation=line(simulation), K=K)


def power(simulation):
    return _POWER.format(simulation=line(simulation))


def orbit(simulation):
    """Return the model text of Kepler's problem in polar coordinates."""
    return _ORBIT.format(simulation=line(simulation))


def pendulum(amplitude=1, simulation=None):
    return _PENDULUM.format(amplitude=amplitude, simulation=line(simulation))


def held_pendulum(amplitude=1, simulation=None):
    return _HELD.format(amplitude=amplitude, simulation=line(simulation))


def scene(initial, potential="0", kinetic="", **sections):
    """Write a model; its coordinates are the names in `initial` that are no rates.

    Each has mass 1 where no kinetic energy is given. Other sections, `coordinates` as
    well, are the entries of a mapping: forces="x: -x_dot".
    """
    plain = re.sub(r"\{.*?\}", "", initial)
    names = [q for q in re.findall(r"(\w+):", plain) if not q.endswith("_dot")]
    masses = " + ".join(f"{q}_dot^2" for q in names)
    kinetic = kinetic or (f"({masses})/2" if len(names) > 1 else f"{masses}/2")
    given = {
        "coordinates": ", ".join(f"{q}: {{}}" for q in names),
        "energy": f"kinetic: {kinetic}, potential: {potential}",
        "initial": initial,
    }
    return "".join(f"{k}: {{{text}}}\n" for k, text in (given | sections).items())


def line(simulation):
    return f"simulation: {{{simulation}}}" if simulation else ""


def angle(found):
    """Return the angle of either pendulum."""
    if "a" in found.system.columns.names:
        return found["a"]
    return np.arctan2(found["x"], -found["y"])


def swing(t, amplitude=1.0):
    """Return the angle of a pendulum released at `amplitude`: elliptic functions.

    sin(a/2) = k sn(K - t, k^2), k = sin(amplitude/2).
    """
    k = math.sin(amplitude / 2.0)
    return 2.0 * np.arcsin(k * ellipj(ellipk(k * k) - t, k * k)[0])


def swing_rate(t, amplitude=1.0):
    """Return the rate of the angle of `swing`: -2 k cn(K - t, k^2)."""
    k = math.sin(amplitude / 2.0)
    return -2.0 * k * ellipj(ellipk(k * k) - t, k * k)[1]


def quarter(amplitude):
    """Return the time at which the pendulum of `swing` first hangs down: K(k)."""
    return ellipk(math.sin(amplitude / 2.0) ** 2)


def fall(until, *, y="h", v=0, duration=5, more=""):
    return _FALL.format(until=until, y=y, v=v, duration=duration, more=more)


def ball(simulation, *, e=0.8, g=9.81, h=1):
    """Ball that falls onto a floor; `bounced` has its height."""
    return _BALL.format(simulation=line(simulation), e=e, g=g, h=h)


def escape(simulation):
    """x'' = 2 x^3 from x = x' = 1: x = 1/(1 - t), without end at t = 1."""
    return scene("x: 1, x_dot: 1", "-x^4/2", simulation=simulation)


def stiff(simulation):
    """Coordinate x, which a spring and a damper hold at sin(y); y goes on slowly."""
    return scene(
        "x: sin(1), y: 1",
        "K*(x - sin(y))^2/2 + y^2/2",
        parameters="K: 1e8, c: 2e5",
        forces="x: -c*(x_dot - y_dot*cos(y)), y: c*(x_dot - y_dot*cos(y))*cos(y)",
        simulation=simulation,
    )


def ellipse(e, simulation):
    """Orbit of axis 1 and period 2 pi from its pericentre; see `on_ellipse`."""
    speed = math.sqrt((1.0 + e) / (1.0 - e))
    start = f"x: {1.0 - e!r}, y: 0, x_dot: 0, y_dot: {speed!r}"
    return scene(start, "-1/sqrt(x^2 + y^2)", simulation=simulation)


def on_ellipse(t, e):
    """Return x and y of `ellipse` at times t (k,), by Kepler's equation."""
    anomaly = np.array(t, dtype=float)
    for _ in range(60):
        off = anomaly - e * np.sin(anomaly) - t
        anomaly -= off / (1.0 - e * np.cos(anomaly))
    return np.cos(anomaly) - e, math.sqrt(1.0 - e * e) * np.sin(anomaly)


def stopped(t, e, w=0.5):
    """Return x of x'' = -x from rest at 1 with a stop at -w, and its impacts.

    Off the stop with speed v it swings out to hypot(w, v), and is back after
    2 (pi - acos(w/hypot(w, v))).

    Returns
    -------
    x : array (k,)
        At times t (k,).
    times : list of float
        Of impacts until the last of t.
    """
    t, begin, v = np.asarray(t), math.acos(-w), math.sqrt(1.0 - w * w)
    times, x = [], np.cos(t)
    while begin < t[-1]:
        times.append(begin)
        v *= e
        s = t - begin
        x = np.where(s > 0.0, v * np.sin(s) - w * np.cos(s), x)
        begin += 2.0 * (math.pi - math.acos(w / math.hypot(w, v)))
    return x, times


def bounced(t, e, height=1.0, g=9.81):
    """Return the height of a ball released at `height`; 0 once its bounces end."""
    begin, v = math.sqrt(2.0 * height / g), e * math.sqrt(2.0 * height * g)
    y = np.where(t < begin, height - g * t**2 / 2.0, 0.0)
    while v > 1e-12 and begin <= np.max(t):
        s, flight = t - begin, 2.0 * v / g
        y = np.where((s >= 0.0) & (s < flight), v * s - g * s**2 / 2.0, y)
        begin, v = begin + flight, e * v
    return y


def expected_times(start, end, step):
    rows = itertools.takewhile(
        lambda t: t < end - 1e-9 * step, (start + k * step for k in itertools.count())
    )
    return [*rows, end]
