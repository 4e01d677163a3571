"""Text and LaTeX, read back as a person reads them, against the numbers of JSON.

The content of JSON is compared with sympy's own derivation in `test_oracle`. Labels and
prose are tested in whole documents, see `stored`.
"""

import contextlib
import functools
import re
import unicodedata

import numpy as np
import pytest

from lagsim.show.latex import as_latex
from lagsim.show.printers import as_json
from lagsim.show.text import as_text
from tests.show.cases import content_with_everything, known, numbers
from tests.show.reading import UnreadableError, latex_rows, text_rows, value

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
    """Yield all expressions of a document in JSON that text and LaTeX show in rows."""
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
    """Return the permitted values of a row: its formulas, and left side less right."""
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
