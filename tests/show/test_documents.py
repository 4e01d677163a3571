"""Text and LaTeX, read back as a person reads them, against the numbers of JSON.

What JSON gives is held to sympy's own derivation in `test_oracle`. Labels and prose are
those of whole documents, which are kept beside.
"""

import contextlib
import functools
import json
import re
import unicodedata
from pathlib import Path

import numpy as np
import pytest

from lagsim.show.as_python import as_python
from lagsim.show.lagrange import content
from lagsim.show.latex import as_latex
from lagsim.show.printers import as_json
from lagsim.show.text import as_text
from tests.show.cases import equations_of, known, numbers, small
from tests.show.reading import UnreadableError, latex_rows, text_rows, value
from tests.show.test_formats import EVERY_FUNCTION

DOCUMENTS = Path(__file__).parent / "documents"

# Models, and how many quantities are conserved, by hand.
CONSERVED = {
    "elastic-pendulum": 1, "elastic-pendulum-curve": 1, "elastic-pendulum-steered": 1,
    "elastic-pendulum-forced": 0, "forced-oscillator": 0, "moving-pivot": 0,
    "pendulum-cartesian": 1, "bead-hoop": 1, "bead-hoop-cartesian": 0,
    "charged-particle": 3, "kepler": 2, "chaplygin-sleigh": 1, "stick-slip": 0,
}  # fmt: skip
LETTERS = {"theta": "θ", "phi": "φ", "psi": "ψ", "Omega": "Ω", "omega": "ω", "mu": "μ"}
MARKS = ("", "\u0307", "\u0308")


def in_ascii(name, order):
    return name + ("", "_dot", "_ddot")[order]


def in_text(name, order):
    shown = LETTERS.get(name, re.sub(r"(?<=\D)0$", "₀", name))
    return unicodedata.normalize("NFC", shown[0] + MARKS[order] + shown[1:])


def in_latex(name, order):
    shown = rf"\{name}" if name in LETTERS else name[0]
    below = "_{0}" if re.fullmatch(r"\w0", name) else ""
    shown = shown if below or name in LETTERS else name
    return (f"\\{'d' * order}ot{{{shown}}}" if order else shown) + below


STYLES = {
    "text": (as_text, in_text, text_rows, "λ_{}"),
    "ascii": (
        functools.partial(as_text, ascii_only=True), in_ascii, text_rows, "lambda_{}",
    ),
    "latex": (as_latex, in_latex, latex_rows, r"\lambda_{{\mathrm{{{}}}}}"),
}  # fmt: skip


def expressions(d):
    """Give all expressions of a document in JSON that text and LaTeX show in rows."""
    if d["kinetic"] is not None:
        yield from (d["kinetic"], d["potential"])
    yield from (d["lagrangian"], *d["definitions"].values())
    yield from filter(None, [d["dissipation"]])
    for force in d["forces"]:
        if force["direction"] != force["on"]:
            yield force["direction"]
    for line in d["equations"]:
        terms = (line[k] for k in line if k not in ("coordinate", "momentum", "right"))
        yield from (*terms, f"({line['left']}) - ({line['right']})")
    yield from d["f"]
    for k in d["constraints"]:
        yield from (k["b"], k["acceleration"], k["function"])
        yield from [k["rate"]] if k["kind"] == "holonomic" else []
    if d["accelerations"] is not None:
        yield from (*d["accelerations"]["q_ddot"], *d["accelerations"]["lambda"])
    yield from (k["expression"] for k in d["conserved"])
    gauss = d["gauss"]
    yield from (gauss["G"], *filter(None, gauss["a"].values()))
    for row in gauss["K"] or ():
        yield from row
    yield from gauss["Qc"] or ()


@functools.cache
def content_with_everything(name):
    return content(equations_of(name), with_gauss=True)


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("name", CONSERVED)
def test_documents_by_value(name, style):
    c, (document, look, rows, multiplier) = content_with_everything(name), STYLES[style]
    d, random = as_json(c), np.random.default_rng(7)
    assert len(d["conserved"]) == CONSERVED[name]
    plain = {p: x * random.uniform(0.9, 1.1) for p, x in d["parameters"].items()}
    plain["t"] = 0.3
    for q in d["coordinates"]:
        plain |= {
            f"{q}{end}": random.uniform(0.3, 1.5) for end in ("", "_dot", "_ddot")
        }
    plain |= {f"lambda_{k['name']}": random.uniform(0.3, 1.5) for k in d["constraints"]}
    plain |= {a: random.uniform(0.3, 1.5) for a in d["gauss"]["a"]}
    plain = known(d, plain)
    shown = {multiplier.format(k["name"]): plain[f"lambda_{k['name']}"]
             for k in d["constraints"]}  # fmt: skip
    for q in d["coordinates"]:
        for order in range(3):
            shown[look(q, order)] = plain[in_ascii(q, order)]
        free = rf"a_{{{look(q, 0)}}}" if style == "latex" else f"a_{look(q, 0)}"
        shown[free] = plain[f"a_{q}"]
    for name_ in (*d["parameters"], *d["definitions"], "t"):
        shown[look(name_, 0)] = plain[name_]
    expected = numbers(list(expressions(d)), plain)
    found = [(row, _values(row, shown)) for row in rows(document(c))]
    for x in expected:
        assert any(is_near(x, y) for _, several in found for y in several), x
    for row, several in found:
        assert not several or any(is_near(x, y) for y in several for x in expected), row


def is_near(x, y):
    # Some hundred operations on numbers that may cancel.
    return abs(x - y) <= 1e-9 * max(1.0, abs(x))


def _values(row, shown):
    """Give what a row may say: its formulas, and the left side less the right."""
    label, formula = row
    prose = label in ("Qc", "a") or label.endswith("makes G")
    if not formula or formula.startswith("[") or prose:
        return []
    found = []
    for piece in [label, *formula.split(" = ")]:
        with contextlib.suppress(UnreadableError, ZeroDivisionError):
            found.append(value(piece, shown))
    assert found, row
    return [*found, found[0] - found[-1]]


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


def shipped(name):
    return content_with_everything(name)


STORED = {
    "steered": lambda: shipped("elastic-pendulum-steered"),
    "curve": lambda: shipped("elastic-pendulum-curve"),
    "forced": lambda: shipped("elastic-pendulum-forced"),
    "charged": lambda: shipped("charged-particle"),
    "moving": lambda: shipped("bead-hoop-cartesian"),
    "hoop": lambda: shipped("bead-hoop"),
    "names": lambda: small(CLASHES, with_gauss=True),
    "numbers": lambda: content(
        equations_of("elastic-pendulum-forced"), substitute=True
    ),
    "contact": lambda: small(CONTACT),
    "laws": lambda: small(LAWS, with_gauss=True),
    "pair": lambda: small(PAIR),
    "wide": lambda: small(WIDE),
    "functions": lambda: small(EVERY_FUNCTION),
}


def told_to_programs(c):
    """Give the document without what changes with every version."""
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


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("name", STORED)
def test_whole_documents(name, suffix):
    """As they were read and approved by a person; formulas also by value, above."""
    stored = (DOCUMENTS / f"{name}.{suffix}").read_text(encoding="utf-8")
    assert FORMATS[suffix](stored_content(name)) == stored


@functools.cache
def stored_content(name):
    return STORED[name]()
