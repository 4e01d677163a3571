"""Every sign and label of text and LaTeX: read back, against sympy's own derivation.

What is read is what a person reads: formulas become numbers at random states, labels
are those that a textbook would write. Whole documents, prose too, are kept beside.
"""

from __future__ import annotations

import functools
import json
import re
import unicodedata
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import sympy as sp
import yaml

from lagsim.show.as_json import as_json
from lagsim.show.lagrange import content
from lagsim.show.latex import as_latex
from lagsim.show.text import as_text
from tests.show.cases import equations_of, small
from tests.show.reading import latex_rows, text_rows, value
from tests.show.test_formats import EVERY_FUNCTION
from tests.support import MODELS
from tests.sympy_oracle import Oracle, random_values, symbol

if TYPE_CHECKING:
    from collections.abc import Callable


DOCUMENTS = Path(__file__).parent / "documents"

# What is conserved, by hand: label and formula in the model's language.
CONSERVED: dict[str, list[tuple[str, str]]] = {
    "elastic-pendulum": [("T + V", "energy")],
    "elastic-pendulum-curve": [("T + V", "energy")],
    "elastic-pendulum-steered": [("T + V", "energy")],
    "elastic-pendulum-forced": [],
    "forced-oscillator": [],
    "moving-pivot": [],
    "pendulum-cartesian": [("T + V", "energy")],
    "bead-hoop": [("h", "energy")],
    "bead-hoop-cartesian": [],
    "charged-particle": [
        ("h", "energy"),
        ("shifted y", "m*y_dot + q*B*x"),
        ("p z", "m*z_dot"),
    ],
    "kepler": [("T + V", "energy"), ("angular", "x*y_dot - y*x_dot")],
    "chaplygin-sleigh": [("T + V", "energy")],
    "stick-slip": [],
}
# Definitions that keep their names, and models whose accelerations are short.
KEPT: dict[str, list[str]] = {"elastic-pendulum-steered": ["p"], "kepler": ["r"]}
SOLVED = {*CONSERVED} - {"elastic-pendulum-steered", "bead-hoop-cartesian"}
UNICODE = {"theta": "θ", "phi": "φ", "psi": "ψ", "Omega": "Ω", "omega": "ω", "mu": "μ"}
UNICODE |= {"F0": "F₀", "v0": "v₀", "f0": "f₀"}
LATEX = {k: rf"\{k}" for k in ("theta", "phi", "psi", "Omega", "omega", "mu")}
LATEX |= {"F0": "F_{0}", "v0": "v_{0}", "f0": "f_{0}"}
MARKS = ("", "\u0307", "\u0308")


class Text:
    """What labels look like in Unicode."""

    minus, partial = "−", "∂"
    rows = staticmethod(text_rows)

    def __init__(self, c: Any) -> None:
        self.document = as_text(c)

    def name(self, q: str, order: int = 0) -> str:
        shown = UNICODE.get(q, q)
        shown = shown[0] + MARKS[order] + shown[1:]
        return unicodedata.normalize("NFC", shown)

    def multiplier(self, c: str) -> str:
        return f"λ_{c}"

    def slope(self, of: str, by: str) -> str:
        return f"{self.partial}{of}/{self.partial}{by}"

    def rate(self, of: str, v: str) -> str:
        return f"d/dt {self.slope(of, v)}"

    def constraint(self, c: str, kind: str) -> tuple[str, list[str]]:
        ends = ["g", "dg/dt", "d²/dt²"] if kind == "holonomic" else ["", "d/dt of it"]
        return f"Constraint {c} ({kind})", ends

    L = "L"

    def lagrangian(self, truth: Truth) -> str:
        # It gives way to a parameter of the file.
        own = "lagrangian" if "L" in truth.oracle.parameter_texts else "L"
        return f"{own} = T {self.minus} V"

    dissipation = "dissipation F"

    def where(self, k: int, name: str) -> str:
        return f"where {name}" if k == 0 else name

    def equation(self, q: str) -> str:
        return f"Equation of {q}"

    motion = equation

    def entry(self, letter: str, *of: str) -> str:
        return f"{letter}[{', '.join(of)}]"

    def conserved(self, label: str) -> str:
        kind, _, q = label.partition(" ")
        words = {"shifted": "shifted momentum", "angular": "angular momentum"}
        return f"p_{self.name(q)}" if kind == "p" else words.get(kind, label)

    kept = "Conserved"

    def unconstrained(self, q: str) -> str:
        return f"a_{q}"

    def force(self, letter: str, q: str) -> str:
        return f"{letter}_{q}"

    def matrices(self) -> dict[str, list[list[str]]]:
        found: dict[str, list[list[str]]] = {}
        letter = ""
        for line in self.document.splitlines():
            if m := re.fullmatch(r"  ([MA] =|   ) \[ (.*) \]", line):
                letter = m[1][0] if m[1].strip() else letter
                cells = re.split(r"\s{2,}", m[2].strip())
                found.setdefault(letter, []).append(cells)
        return found


class Ascii(Text):
    """What labels look like in ASCII: the model's language."""

    minus, partial = "-", "d"

    def __init__(self, c: Any) -> None:
        self.document = as_text(c, ascii_only=True)

    def name(self, q: str, order: int = 0) -> str:
        return q + ("", "_dot", "_ddot")[order]

    def multiplier(self, c: str) -> str:
        return f"lambda_{c}"

    def constraint(self, c: str, kind: str) -> tuple[str, list[str]]:
        title, ends = super().constraint(c, kind)
        return title, [e.replace("²", "^2") for e in ends]


class Latex(Text):
    """What labels look like in LaTeX."""

    rows = staticmethod(latex_rows)

    def __init__(self, c: Any) -> None:
        self.document = as_latex(c)

    def name(self, q: str, order: int = 0) -> str:
        shown, mark, below = LATEX.get(q, q).partition("_")
        return (f"\\{'d' * order}ot{{{shown}}}" if order else shown) + mark + below

    def multiplier(self, c: str) -> str:
        return rf"\lambda_{{\mathrm{{{c}}}}}"

    def slope(self, of: str, by: str) -> str:
        return rf"\frac{{\partial {of}}}{{\partial {by}}}"

    def rate(self, of: str, v: str) -> str:
        return rf"\frac{{d}}{{dt}} {self.slope(of, v)}"

    def constraint(self, c: str, kind: str) -> tuple[str, list[str]]:
        letter = "g" if kind == "holonomic" else r"\varphi"
        marks = ["", r"\dot", r"\ddot"][: 3 if kind == "holonomic" else 2]
        below = rf"_{{\mathrm{{{c}}}}}"
        ends = [(f"{m}{{{letter}}}" if m else letter) + below for m in marks]
        return f"Constraint {c} ({kind})", ends

    L = r"\mathcal{L}"

    def lagrangian(self, truth: Truth) -> str:  # noqa: ARG002
        return r"\mathcal{L} = T - V"

    dissipation = "F"

    def where(self, k: int, name: str) -> str:  # noqa: ARG002
        return name

    def equation(self, q: str) -> str:
        return q

    def motion(self, q: str) -> str:  # noqa: ARG002
        return "The equations of motion are"

    def entry(self, letter: str, *of: str) -> str:
        return f"{letter}_{{{','.join(of)}}}"

    def conserved(self, label: str) -> str:
        kind, _, q = label.partition(" ")
        words = {"shifted": rf"\mathrm{{const}}_{{{q}}}", "angular": r"\mathrm{const}"}
        return f"p_{{{self.name(q)}}}" if kind == "p" else words.get(kind, label)

    kept = "Conserved quantities"

    def unconstrained(self, q: str) -> str:
        return f"a_{{{q}}}"

    def force(self, letter: str, q: str) -> str:
        return f"Q_{{c,{q}}}" if letter == "Qc" else f"{letter}_{{{q}}}"

    def matrices(self) -> dict[str, list[list[str]]]:
        found = {}
        pattern = r"\\mathbf\{(\w)\} = \\begin\{bmatrix\}(.*?)\\end\{bmatrix\}"
        for m in re.finditer(pattern, self.document, re.DOTALL):
            found[m[1]] = [row.split("&") for row in m[2].split("\\\\")]
        return found


@dataclass
class Truth:
    """A model at a random state, by sympy: numbers for whatever a document tells."""

    oracle: Oracle
    values: dict[str, float]
    lam: Any
    q_ddot: Any

    known: dict[Any, float]

    def __call__(self, e: Any) -> float:
        if e not in self.known:
            at = {symbol(name): x for name, x in self.values.items()}
            self.known[e] = float(sp.N(sp.S(e).subs(at), 30))
        return self.known[e]

    def read(self, text: str) -> float:
        return self(self.oracle.read(text))


@functools.cache
def truth_of(name: str) -> Truth:
    oracle = Oracle.of(MODELS / f"{name}.yaml")
    start = {i.name: i.value for i in equations_of(name).model.initial}
    values = random_values(oracle, start, seed=0)
    random = np.random.default_rng(7)
    lam = random.standard_normal(len(oracle.constraints))
    q_ddot = random.standard_normal(len(oracle.q))
    values |= {a.name: float(x) for a, x in zip(oracle.a, q_ddot, strict=True)}
    return Truth(oracle, values, lam, q_ddot, {})


def shown_values(
    style: Text, truth: Truth, kept: list[str], constraints: list[str]
) -> dict[str, float]:
    """Give what each name, as the style shows it, is."""
    o = truth.oracle
    found = {style.name(p): truth.values[p] for p in o.parameter_texts}
    found[style.name("t")] = truth.values["t"]
    for q, v, a in zip(o.q, o.v, o.a, strict=True):
        for order, s in enumerate((q, v, a)):
            found[style.name(q.name, order)] = truth.values[s.name]
    for name in kept:
        found[style.name(name)] = truth(o.name(name))
    for c, x in zip(constraints, truth.lam, strict=True):
        found[style.multiplier(c)] = float(x)
    M, f, _, _ = parts(truth)
    for q, x in zip(o.q, np.linalg.solve(M, f), strict=True):
        found[style.unconstrained(style.name(q.name))] = float(x)
    return found


Expected = list[tuple[str, str, float]]


def energies(style: Text, truth: Truth, kept: list[str], loss: str) -> Expected:
    o = truth.oracle
    if o.kinetic is sp.nan:
        found = [("Energies", style.L, truth(o.L))]
    else:
        found = [("Energies", "T", truth(o.kinetic))]
        found.append(("Energies", "V", truth(o.kinetic - o.L)))
        found.append(("Energies", style.lagrangian(truth), truth(o.L)))
    if loss:
        found.append(("Energies", style.dissipation, truth.read(loss)))
    for k, name in enumerate(kept):
        label = style.where(k, style.name(name))
        found.append(("Energies", label, truth(o.name(name))))
    return found


def terms(style: Text, truth: Truth, j: int) -> Expected:
    """Give the rows of one coordinate, without the equation."""
    o = truth.oracle
    q, v = style.name(o.q[j].name), style.name(o.q[j].name, 1)
    title, V = style.equation(q), o.kinetic - o.L
    if o.kinetic is sp.nan:
        momentum, slope = sp.diff(o.L, o.v[j]), sp.diff(o.L, o.q[j])
        return [
            (title, style.rate(style.L, v), truth(o.rate(momentum))),
            (title, style.slope(style.L, q), truth(slope)),
            (title, style.force("Q", q), truth(o.Q[j])),
        ]
    found = [
        (title, style.rate("T", v), truth(o.rate(sp.diff(o.kinetic, o.v[j])))),
        (title, style.slope("T", q), truth(sp.diff(o.kinetic, o.q[j]))),
    ]
    momentum = sp.diff(V, o.v[j])
    if momentum != 0:
        found.append((title, style.rate("V", v), truth(o.rate(momentum))))
    found.append((title, style.slope("V", q), truth(sp.diff(V, o.q[j]))))
    return [*found, (title, style.force("Q", q), truth(o.Q[j]))]


def constraints(style: Text, truth: Truth, names: list[str]) -> Expected:
    o, found = truth.oracle, []
    for c, g in zip(names, o.constraints, strict=True):
        holonomic = not g.free_symbols & set(o.v)
        kind = "holonomic" if holonomic else "nonholonomic"
        title, labels = style.constraint(c, kind)
        steps = [g, o.rate(g), o.rate(o.rate(g))] if holonomic else [g, o.rate(g)]
        found += [
            (title, label, truth(e))
            for label, e in zip(labels, steps, strict=True)
            if label
        ]
    return found


def gauss(style: Text, truth: Truth, numbers: Any, labels: list[str]) -> Expected:
    """Give Gauss's principle from M, f, A and b alone."""
    o, title = truth.oracle, "Gauss's principle"
    M, f, A, b = numbers
    names = [style.name(q.name) for q in o.q]
    a = np.linalg.solve(M, f)
    off = truth.q_ddot - a
    found = [(title, "G", float(off @ M @ off) / 2.0)]
    found += [
        (title, style.unconstrained(q), float(x)) for q, x in zip(names, a, strict=True)
    ]
    if not len(b):
        return found
    K = -A.T @ np.linalg.inv(A @ np.linalg.solve(M, A.T))
    for q, row in zip(names, K, strict=True):
        found += [
            (title, style.entry("K", q, c), float(x))
            for c, x in zip(labels, row, strict=True)
        ]
    force = K @ (A @ a - b)
    return found + [
        (title, style.force("Qc", q), float(x))
        for q, x in zip(names, force, strict=True)
    ]


def told(
    style: Text, values: dict[str, float], labels: set[tuple[str, str]]
) -> tuple[Expected, list[float]]:
    """Give the rows with known labels, and left - right of all other equations."""
    rows, equations = [], []
    for row in style.rows(style.document):
        section = "Matrix form" if "Matrix form" in row.section else row.section
        label, formula = row.label, row.formula
        head, equals, rest = formula.partition(" = ")
        if equals and (section, f"{label} = {head}") in labels:
            label, formula = f"{label} = {head}", rest
        if (section, label) in labels:
            number = value(formula.removesuffix("= 0"), values)
            rows.append((section, label, number))
        elif formula and not is_prose(label, formula):
            equations.append(value(label, values) - value(formula, values))
    return rows, equations


def is_prose(label: str, formula: str) -> bool:
    """Tell what the stored documents hold to the letter."""
    return formula.startswith("[") or label.endswith("makes G") or label == "Qc"


def forces(style: Text, truth: Truth, document: Any) -> Expected:
    o, section = truth.oracle, "Generalized forces by virtual work"
    listed = document.get("forces") or {}
    if not listed and "dissipation" not in document["energy"]:
        return []
    found = [
        (section, style.name(on), truth(o.name(on)))
        for on in listed
        if not o.name(on).is_Symbol
    ]
    return found + [
        (section, style.force("Q", style.name(q.name)), truth(Q))
        for q, Q in zip(o.q, o.Q, strict=True)
    ]


def told_forces(style: Text, values: dict[str, float]) -> list[tuple[str, float]]:
    """Give (on, force) of the sentences on forces."""
    pattern = r"  force on (?P<on>.*?): (?P<f>.*?)\n"
    if isinstance(style, Latex):
        pattern = r"Force on \$(?P<on>.*?)\$: \$(?P<f>.*?)\$\."
    found = re.finditer(pattern, style.document)
    return [(m["on"], value(m["f"], values)) for m in found]


def expectations(style: Text, name: str, *, solved: bool) -> Expected:
    truth, document = truth_of(name), yaml_of(name)
    o, section = truth.oracle, "Matrix form"
    numbers = [np.array(x, dtype=float) for x in parts(truth)]
    M, f, A, b = numbers
    names = [style.name(q.name) for q in o.q]
    found = energies(style, truth, KEPT.get(name, []), dissipation(document))
    found += forces(style, truth, document)
    for j in range(len(o.q)):
        found += terms(style, truth, j)
    found += [(section, style.entry("f", q), x) for q, x in zip(names, f, strict=True)]
    labels = list(document.get("constraints") or {})
    upright = [rf"\mathrm{{{c}}}" if isinstance(style, Latex) else c for c in labels]
    found += [
        (section, style.entry("b", c), x) for c, x in zip(upright, b, strict=True)
    ]
    found += constraints(style, truth, labels)
    if solved:
        # Multipliers in the accelerations stand for the numbers chosen for them.
        q_ddot = np.linalg.solve(M, f + A.T @ truth.lam)
        found += [
            ("Accelerations", style.name(q.name, 2), x)
            for q, x in zip(o.q, q_ddot, strict=True)
        ]
        if len(b):
            lam = np.linalg.solve(
                A @ np.linalg.solve(M, A.T), b - A @ np.linalg.solve(M, f)
            )
            found += [
                ("Accelerations", style.multiplier(c), x)
                for c, x in zip(labels, lam, strict=True)
            ]
    for label, text in CONSERVED[name]:
        number = truth(o.energy) if text == "energy" else truth.read(text)
        found.append((style.kept, style.conserved(label), number))
    return found + gauss(style, truth, numbers, upright)


def parts(truth: Truth) -> list[Any]:
    o = truth.oracle
    m, n = len(o.constraints), len(o.q)
    flat = [*sp.flatten(o.M), *o.f, *sp.flatten(o.A), *o.b]
    numbers = np.array([truth(e) for e in flat])
    M, f, A, b = np.split(numbers, np.cumsum([n * n, n, m * n]))
    return [M.reshape(n, n), f, A.reshape(m, n), b]


def dissipation(document: Any) -> str:
    return document["energy"].get("dissipation", "")


@functools.cache
def yaml_of(name: str) -> Any:
    text = (MODELS / f"{name}.yaml").read_text(encoding="utf-8")
    return yaml.load(text, Loader=yaml.BaseLoader)  # noqa: S506  all scalars are text


@functools.cache
def content_with_everything(name: str) -> Any:
    return content(equations_of(name), with_gauss=True)


@pytest.mark.parametrize("style", [Text, Ascii, Latex])
@pytest.mark.parametrize("name", CONSERVED)
def test_documents_by_value(name: str, style: Callable[..., Text]) -> None:
    c = content_with_everything(name)
    shown, truth = style(c), truth_of(name)
    expected = expectations(shown, name, solved=name in SOLVED)
    values = shown_values(
        shown, truth, KEPT.get(name, []), list(yaml_of(name).get("constraints") or {})
    )
    rows, equations = told(shown, values, {(s, label) for s, label, _ in expected})
    order = sorted if isinstance(shown, Latex) else list
    assert order((s, x) for s, x, _ in rows) == order((s, x) for s, x, _ in expected)
    numbers = {(s, x): y for s, x, y in expected}
    for section, label, number in rows:
        # Some hundred operations on numbers that may cancel.
        want = numbers[section, label]
        assert number == pytest.approx(want, rel=1e-9, abs=1e-9), (section, label)
    M, f, A, _ = parts(truth)
    motion = list(M @ truth.q_ddot - f - A.T @ truth.lam)
    if not isinstance(shown, Latex):
        motion += [
            truth(g)
            for g in truth.oracle.constraints
            if g.free_symbols & set(truth.oracle.v)
        ]
    assert equations == pytest.approx(motion, rel=1e-9, abs=1e-9)
    listed = yaml_of(name).get("forces") or {}
    sentences = [(shown.name(on), truth.read(entry)) for on, entry in listed.items()]
    found = told_forces(shown, values)
    assert [on for on, _ in found] == [on for on, _ in sentences]
    assert [x for _, x in found] == pytest.approx([x for _, x in sentences])
    matrices = shown.matrices()
    for letter, matrix in (("M", M), ("A", A)):
        if len(matrix):
            told_matrix = [[value(e, values) for e in row] for row in matrices[letter]]
            assert np.allclose(told_matrix, matrix, rtol=1e-9, atol=1e-12)


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


def shipped(name: str) -> Any:
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


def told_to_programs(c: Any) -> dict[str, Any]:
    """Give the document without what changes with every version."""
    document = as_json(c)
    del document["lagsim"], document["model"]
    return document


FORMATS = {
    "txt": as_text,
    "ascii.txt": lambda c: as_text(c, ascii_only=True),
    "tex": as_latex,
    "json": lambda c: json.dumps(told_to_programs(c), indent=1) + "\n",
}


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("name", STORED)
def test_whole_documents(name: str, suffix: str) -> None:
    """As they were read and approved by a person; formulas also by value, above."""
    stored = (DOCUMENTS / f"{name}.{suffix}").read_text(encoding="utf-8")
    assert FORMATS[suffix](stored_content(name)) == stored


@functools.cache
def stored_content(name: str) -> Any:
    return STORED[name]()
