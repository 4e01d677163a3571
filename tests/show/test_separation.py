"""Equations in the definitions of the file: by value, and in their length."""

import functools
import math
import re

import numpy as np
import pytest

import lagsim
from lagsim import show as shown
from lagsim.language.evaluate import evaluate
from lagsim.language.names import rate_of
from lagsim.mechanics.derivation import derive
from lagsim.model.reader import read, read_file
from lagsim.show import text
from lagsim.show.lagrange import derived
from lagsim.show.latex import _width as width
from lagsim.show.latex import as_latex
from lagsim.show.printers import as_json
from lagsim.show.text import as_text
from tests.mechanics.test_equations import rows_of
from tests.show.cases import LONG, numbers
from tests.show.latex_checker import check
from tests.support import MODELS, SHIPPED, refused

# Models that are given so, and how many lines of text are enough.
LINES = {
    "bicycle": 380, "quadruped": 90, "seven-joint-arm": 180, "heavy-top-quaternion": 85,
    "spacecraft": 110, "chain-angles": 40, "chain-cartesian": 40, "chain-on-a-cart": 45,
}  # fmt: skip
TORQUE = """
coordinates: {a: {}, b: {}, u: {}}
frames: {one: {axis: [0, 0, 1], angle: a}, two: {on: one, axis: [1, 0, 0], angle: b}}
definitions:
  w: omega(two)
  r: rotate(two, vec(0, 0, u))
  slip: w.x - u_dot
  way: {value: r.x + t}
bodies: {top: {mass: 2, at: r, frame: two, inertia: [1, 2, 3]}}
energy: {kinetic: bodies, potential: 5*r.z, dissipation: 0.3*w.z^2 + 0.1*r_dot.z^2}
forces: {w.y: sin(t)*b, r.y: 3*u, way: a}
constraints: {slides: slip + 0.1*w.z, held: r.z + 0.2*a - 1}
initial: {a: 0.1, b: 0.2, u: {guess: 1}, a_dot: {guess: 0}, u_dot: {guess: 0}}
"""
NAME = re.compile(r"(?<![\w.])[^\W\d]\w*(?:\(\d+\)|\.\w+)*(?!\w*\()")


@functools.cache
def equations_of(name):
    return derive(read_file(str(MODELS / f"{name}.yaml")), chained=False)


def value(formula, values):
    """Return the number of a formula in ASCII, with sums and members by numbers."""
    while m := re.search(r"sum\((\w) = (\d+)\.\.(\d+), ", formula):
        depth, end = 1, m.end()
        while depth:
            depth += {"(": 1, ")": -1}.get(formula[end], 0)
            end += 1
        terms = (
            f"({at(formula[m.end() : end - 1], m[1], k)})"
            for k in range(int(m[2]), int(m[3]) + 1)
        )
        formula = f"{formula[: m.start()]}({' + '.join(terms)}){formula[end:]}"

    def number(m):
        name = re.sub(r"\((\d+)\)", r".\1", m[0])
        if name in values:
            return f"({float(values[name])!r})"
        plain = re.sub(r"^([^\W\d]+?)((?:_d?dot)?)\.(\d+)$", r"\1\3\2", name)
        plain = re.sub(r"^(lambda_\w+)\.(\d+)$", r"\1\2", plain)
        return f"({float(values[plain])!r})" if plain in values else m[0]

    return numbers([NAME.sub(number, formula)], {})[0]


def at(formula, letter, k):
    """Replace the letter of a member by its number."""
    return re.sub(
        rf"\({letter}([+-]\d+)?\)", lambda m: f"({k + int(m[1] or 0)})", formula
    )


def state_of(e, seed=4):
    random = np.random.default_rng(seed)
    values = {p.name: p.value for p in e.model.parameters}
    values |= {name: random.uniform(0.3, 1.2) for name in e.moving}
    values |= {rate_of(q, 2): random.uniform(-1.0, 1.0) for q in e.q}
    values |= {
        f"lambda_{c.name}": random.uniform(-1.0, 1.0) for c in e.model.constraints
    }
    return values


def valued(d, values):
    """Add the values of definitions, then of momenta, their rates and reactions."""
    found = {**values, "pi": math.pi}
    for group in (d["definitions"], *d.get("separated", {}).values()):
        for name, formula in group.items():
            found[name] = value(formula, found)
    return found


def balances(d, values):
    return np.array(
        [value(x["left"], values) - value(x["right"], values) for x in d["equations"]]
    )


def check_by_value(e):
    c = derived(e)
    d, values = as_json(c), state_of(e)
    assert "separated" in d
    known = valued(d, values)
    rows, n = rows_of(e), len(e.q)
    M, A = (
        np.reshape(evaluate(e.graph, [x for row in m for x in row], values), (-1, n))
        for m in (e.M, [row.A for row in rows])
    )
    f = np.array(evaluate(e.graph, e.f, values))
    a = np.array([values[rate_of(q, 2)] for q in e.q])
    lam = np.array([values[f"lambda_{row.name}"] for row in rows])
    size = np.abs(M) @ np.abs(a) + np.abs(f) + np.abs(A.T) @ np.abs(lam)
    error = balances(d, known) - (M @ a - f - A.T @ lam)
    assert np.max(np.abs(error)) <= 1e-11 * np.max(size)
    given = np.array([[value(x, known) for x in row] for row in d["M"]])
    np.testing.assert_allclose(given, M, rtol=0, atol=1e-12 * np.max(np.abs(M)))
    return d, known


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_the_equations_are_those_of_the_graph(name, monkeypatch):
    monkeypatch.setattr(shown, "MOST_ROWS", -1)
    if equations_of(name).model.tables:
        pytest.skip("the values of a table are not read here")
    check_by_value(equations_of(name))


@pytest.mark.slow
def test_torques_slips_and_losses_along_definitions(monkeypatch):
    monkeypatch.setattr(shown, "MOST_ROWS", -1)
    d, _ = check_by_value(derive(read(TORQUE, "model.yaml"), chained=False))
    assert d["separated"]["forces"]


@pytest.mark.slow
@pytest.mark.parametrize("links", [60, pytest.param(200, marks=pytest.mark.slow)])
def test_a_long_chain_is_shown_as_one_of_30(links):
    texts = {}
    for n in (30, links):
        model = read_file(str(MODELS / "chain-on-a-cart.yaml"), {"n": str(n)})
        texts[n] = lagsim.derive(model).as_text(ascii_only=True)
    longer = re.sub(r"\b30\b", str(links), texts[30])
    assert re.sub(r"\b29\b", str(links - 1), longer) == texts[links]


@pytest.mark.slow
def test_the_arm_by_recursive_newton_and_euler():
    """Forces and torques from link to link (Featherstone, section 5.3)."""
    e = equations_of("seven-joint-arm")
    d, values = as_json(derived(e)), state_of(e)
    q, v, a = ([values[rate_of(x, k)] for x in e.q] for k in range(3))
    m, link, c, g, damping = 1.0, 0.3, 0.15, 9.81, 0.05
    J = np.array([0.01, 0.012, 0.004])
    R, w, alpha, tip = np.eye(3), np.zeros(3), np.zeros(3), np.array([0.0, 0.0, g])
    links = []
    for k in range(7):
        co, si = math.cos(q[k]), math.sin(q[k])
        y = np.array([[co, 0, si], [0, 1, 0], [-si, 0, co]])
        z = np.array([[co, -si, 0], [si, co, 0], [0, 0, 1]])
        axis = R @ ([0, 0, 1], [0, 1, 0])[k % 2]
        R = R @ (z, y)[k % 2]
        alpha = alpha + axis * a[k] + np.cross(w, axis * v[k])
        w = w + axis * v[k]
        arm = R @ [0, 0, c]
        centre = tip + np.cross(alpha, arm) + np.cross(w, np.cross(w, arm))
        Js = R @ np.diag(J) @ R.T
        links.append((axis, R, m * centre, Js @ alpha + np.cross(w, Js @ w)))
        arm = R @ [0, 0, link]
        tip = tip + np.cross(alpha, arm) + np.cross(w, np.cross(w, arm))
    force, torque, expected = np.zeros(3), np.zeros(3), []
    for axis, R, own, turning in reversed(links):
        torque = torque + turning + np.cross(R @ [0, 0, c], own)
        torque = torque + np.cross(R @ [0, 0, link], force)
        force = force + own
        expected.insert(0, axis @ torque)
    found = balances(d, valued(d, values)) - damping * np.array(v)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize(
    "model", [pytest.param(x, marks=[pytest.mark.slow] * (x in LONG)) for x in LINES]
)
def test_text_is_short_and_says_the_same(model, monkeypatch):
    monkeypatch.setattr(text, "WIDTH", 100_000)
    e = equations_of(model)
    c = derived(e)
    d = as_json(c)
    values = valued(d, state_of(e))
    letters = {
        word if letter in values else letter: value(d[word], values)
        for letter, word in (("T", "kinetic"), ("V", "potential"))
    }
    values |= letters
    [*displays] = check(as_latex(c))
    assert max(width(x) for rows in displays for x in rows.split("\\\\")) <= 80
    balance = dict(zip(d["coordinates"], balances(d, values), strict=True))
    stated, members = set(), []
    for line in as_text(c, ascii_only=True).splitlines():
        row = line.strip().removeprefix("where ")
        if m := re.match(r"for (\w\S*?)(?:, i = (.*))?:$", row):
            members = [(own(m[1], k, values), k) for k in range_of(m[2])]
            continue
        head, _, tail = row.partition(", i = ")
        left, *right = re.split(r" = (?!\d+\.\.)", head)
        if members:
            for q, k in members:
                x, y = (value(at(side, "i", k), values) for side in (left, right[0]))
                assert x - y == pytest.approx(balance[q], rel=1e-4, abs=1e-4), row
            stated |= {q for q, _ in members}
            members = []
        elif len(right) == 1 and not left.startswith(("T + V", "p_", "force.w")):
            for k in range_of(tail):
                name = own(left, k, values)
                if name in values and name[-2:] not in (".u", ".w"):
                    found = value(at(right[0], "i", k), values)
                    assert found == pytest.approx(values[name], rel=1e-4, abs=1e-4), row
                    stated.add(name)
    kept = {
        str(x) for x in c.translation.definitions if not re.match(r"[^.]*_dot", str(x))
    }
    adjoint = [name for k in ("momenta", "reactions") for name in d["separated"][k]]
    assert stated >= {*kept, *adjoint, *d["coordinates"], *letters}
    monkeypatch.undo()
    assert as_text(c).count("\n") <= LINES[model]


def own(shown, k, values):
    """Return the name of a member's row: `r(i).x` is `r.2.x`, `x(i)` may be x2."""
    name = re.sub(r"\((\d+)\)", r".\1", at(shown, "i", k))
    plain = re.sub(r"\.(\d+)$", r"\1", name)
    return name if name in values or plain not in values else plain


def range_of(members):
    """Return the numbers of `2..10`, or `3, 5`; 0 for a row of its own."""
    first, _, last = (members or "0").partition("..")
    if last:
        return [*range(int(first), int(last) + 1)]
    return [*map(int, first.split(", "))]


def test_what_nobody_can_read_is_refused():
    definitions = "  d0: x^2 + x\n"
    definitions += "".join(f"  d{k}: d{k - 1}*d{k - 1} + x\n" for k in range(1, 40))
    text = f"""
coordinates: {{x: {{}}}}
definitions:
{definitions}
energy: {{kinetic: x_dot^2/2, potential: d39}}
initial: {{x: 0}}
"""
    found = derived(derive(read(text, "model.yaml")))
    assert str(found.document["definitions"]["d39"]) == "d38**2 + x"
    with refused("too-long"):
        derived(derive(read(text, "model.yaml")), expand=True)
