"""Documents that are stored whole, as a person has read and approved them.

`benchmarks/regenerate.py` writes the documents to the folder `documents`; changes are
read in the difference before they are committed.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from lagsim.show.as_python import as_python
from lagsim.show.lagrange import derived
from lagsim.show.latex import as_latex
from lagsim.show.printers import as_json
from lagsim.show.text import as_text
from tests.show.cases import content_with_everything, equations_of, small

if TYPE_CHECKING:
    from collections.abc import Iterator

DOCUMENTS = Path(__file__).parent / "documents"

EVERY_FUNCTION = """
parameters: {a: 0.7}
coordinates: {x: {}, y: {}}
energy:
  kinetic: x_dot^2/2 + y_dot^2/2
  potential: >-
    sin(x)*cos(y)*tan(a*x) + asin(x/9)*acos(y/9)*atan(x) + atan2(x, y)
    + sinh(x)*cosh(y)*tanh(x) + asinh(x)*acosh(9 + y) + atanh(x/9) + exp(a*x) + log(y)
    + log10(x + 9) + sqrt(x)*cbrt(y) + abs(x - 3)^3 + sign(x - 3)*y + min(x, y)*y
    + mod(x, y)*x + max(x, 2*y)^2 + hypot(x, y) + floor(x)*y + ceil(y)*x
    + heaviside(x - 9)*x + sinc(x - 3)*y
    + if(x < y and not (x > 2 or y <= 0.1), x^2, y^a) + 2^x + x^1.5 + 1e-9*x + pi*y/3
initial: {x: 0.4, y: 1.2}
"""
CLASHES = """
name: names
description: letters of mechanics that the file takes for itself
parameters: {T: 2, V: 3, L: 4, F: 5, G: 6, h: 7, lambda_1: 8, c: 0.25}
coordinates: {theta1: {}, p_x: {}}
definitions: {spin: T*theta1_dot}
energy:
  kinetic: T*theta1_dot^2/2 + G*p_x_dot^2/2
  potential: V*L*p_x + lambda_1*p_x^2/F + 2^p_x
  dissipation: c*p_x_dot^2/2
forces: {p_x: h*sin(3*t)}
initial: {theta1: 0, p_x: 0}
"""
CONTACT = """
name: contact
parameters: {m: 1, g: 9.81, mu: 0.3}
coordinates: {x: {}, y: {}, z: {}}
energy: {kinetic: m*(x_dot^2 + y_dot^2 + z_dot^2)/2, potential: m*g*y}
constraints:
  floor: {relation: y >= 0, restitution: 0.8, friction: mu, slip: [x_dot, z_dot]}
  wall: {relation: x <= 3, restitution: 0.5}
initial: {x: 0, y: 1, z: 0}
"""
LAWS = """
name: laws
parameters: {m: 1, mu: 0.3, F: 2, T: 0.3}
coordinates: {x: {}, y: {}, a: {}}
energy: {kinetic: m*(x_dot^2 + y_dot^2 + a_dot^2)/2, potential: 0}
constraints:
  floor:
    relation: y >= 0
    restitution: 0
    friction: {static: 2*mu, dynamic: mu}
    slip: x_dot
  wheel: x_dot >= 2*a_dot
  brake: {relation: a_dot = t, limit: F + abs(x)}
  hold: {relation: x = a, when: t < T or t > 4*T}
initial: {x: 0, y: 1, a: 0}
"""
PAIR = """
name: pair
parameters: {m: 1, n: 2, k: 3}
coordinates: {x: {}, y: {}, u: {}, v: {}}
energy:
  kinetic: m*(x_dot^2 + y_dot^2)/2 + n*(u_dot^2 + v_dot^2)/2
  potential: k*((x - u)^2 + (y - v)^2)/2
initial: {x: 0, y: 1, u: 2, v: 3}
"""
# Matrices too wide for a square, terms too many for a line.
WIDE = """
name: wide
parameters: {m: 1, n: 2, k: 3, g: 9.81}
coordinates: {a: {}, b: {}, c: {}, d: {}, e: {}, f: {}, h: {}, i: {}, j: {}}
energy:
  kinetic: >-
    (m + n + 2*k + g^2)*(a_dot^2 + b_dot^2 + c_dot^2 + d_dot^2 + e_dot^2 + f_dot^2
    + h_dot^2 + i_dot^2 + j_dot^2)/2 + m*a_dot*b_dot*cos(c)
  potential: >-
    m*g*a + k*a^3/3 + n*a*b + n*a*c - n*a*d + n*a*e - n*a*f + n*a*h*i + m*sin(a)*j
    + k*a*exp(c) + k*sin(a - d)
constraints:
  long: >-
    (m + 2*n + k)*b + (m + 3*n + k)*c + (m + 4*n + k)*d + (m + 5*n + k)*e^2
    = (m + 6*n + k)*f + (m + 7*n + k)*h + (m + 8*n + k)*i + sin(j)
initial: {a: 0, b: 0, c: 0, d: 0, e: 0, f: 0, h: 0, i: 0, j: 0}
"""


STORED = {
    "steered": lambda: content_with_everything("elastic-pendulum-steered"),
    "curve": lambda: content_with_everything("elastic-pendulum-curve"),
    "forced": lambda: content_with_everything("elastic-pendulum-forced"),
    "charged": lambda: content_with_everything("charged-particle"),
    "moving": lambda: content_with_everything("bead-hoop-cartesian"),
    "hoop": lambda: content_with_everything("bead-hoop"),
    "names": lambda: small(CLASHES, with_gauss=True),
    "numbers": lambda: derived(
        equations_of("elastic-pendulum-forced"), substitute=True
    ),
    "contact": lambda: small(CONTACT),
    "laws": lambda: small(LAWS, with_gauss=True),
    "pair": lambda: small(PAIR),
    "wide": lambda: small(WIDE),
    "functions": lambda: small(EVERY_FUNCTION),
}


def told_to_programs(c):
    """Return the document without entries that change with every version."""
    document = as_json(c)
    del document["lagsim"], document["model"]
    return document


FORMATS = {
    "txt": as_text,
    "ascii.txt": lambda c: as_text(c, ascii_only=True),
    "tex": as_latex,
    # Its functions are held to numbers, in `test_oracle`.
    "py.txt": lambda c: as_python(c.translation.equations, "0").partition("\ndef ")[0],
    "json": lambda c: json.dumps(told_to_programs(c), indent=1) + "\n",
}


def names() -> set[str]:
    """Return the names of all files."""
    return {f"{name}.{suffix}" for name in STORED for suffix in FORMATS}


def documents() -> Iterator[tuple[str, str]]:
    """Yield the name and the text of each file."""
    for name, make in STORED.items():
        made = make()
        for suffix, as_format in FORMATS.items():
            yield f"{name}.{suffix}", as_format(made)
