"""Model files as nobody would write them: what the command must say of each calmly.

A grammar over the file, its expressions and the command line. Numbers are those that
doubles can hardly hold, expressions those that are defined nowhere or almost nowhere.
"""

from __future__ import annotations

from hypothesis import strategies as st

NUMBERS = (
    "0", "1", "-1", "2", "1/3", "0.5", "1e8", "1e16", "1e154", "-1e154", "1e200",
    "1e300", "1e308", "1e-8", "1e-154", "1e-200", "1e-308", "5e-324", "1/0", "0/0",
    "1e400", "(-8)^(1/3)", "0^0", "sqrt(-1)", "log(0)", "pi",
)  # fmt: skip
NAMES = ("x", "y", "x_dot", "y_dot", "x_dot", "t", "k", "p")
CALLS = (
    "sin({})", "cos({})", "tan({})", "asin({})", "exp({})", "log({})", "sqrt({})",
    "abs({})", "sign({})", "floor({})", "tanh({})", "atan2({}, {})", "hypot({}, {})",
    "min({}, {})", "max({}, {})", "{} + {}", "{} - {}", "{}*{}", "{}/{}", "({})^{}",
    "if({} < {}, {}, {})", "if({} = {} or not {} > {}, {}, {})", "-{}", "({})^2",
)  # fmt: skip
RUBBISH = tuple("()[]{}:,+-*/^=<>'\"#&|%@ \t\\~²θ\u202e\x1b\x00")


def _grown(parts: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    def filled(form: str) -> st.SearchStrategy[str]:
        holes = form.count("{}")
        return st.tuples(*[parts] * holes).map(lambda given: form.format(*given))

    return st.sampled_from(CALLS).flatmap(filled)


plain = st.sampled_from(("1", "2", "0.5", "-1", "3", "0"))
numbers = plain | plain | plain | st.sampled_from(NUMBERS)
positions = st.sampled_from(("x", "y", "x", "y", "t", "k"))


def _expressions(leaves: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    return st.recursive(leaves, _grown, max_leaves=5)


of_positions = _expressions(positions | numbers)
expressions = _expressions(st.sampled_from(NAMES) | numbers)


@st.composite
def files(draw: st.DrawFn) -> str:
    """Give the text of a model file, now and then with one letter that is wrong."""
    inertia = st.sampled_from(("1", "1", "2", "k", "0", "1e200", "x"))
    kinetic = f"{draw(inertia)}*x_dot^2/2 + {draw(inertia)}*y_dot^2/2"
    if draw(st.booleans()):
        kinetic = f"{kinetic} + {draw(expressions)}"
    sign = st.sampled_from(("=", ">=", "<="))
    relation = st.tuples(of_positions, sign, of_positions).map(" ".join)
    equation = st.tuples(expressions, st.just("= x +"), expressions).map(" ".join)
    rows = draw(st.lists(relation | equation, max_size=3))
    lines = [
        f"parameters: {{k: {draw(numbers)}}}",
        "coordinates: {x: {}, y: {unit: m}}",
        f"definitions: {{p: '{draw(of_positions)}'}}",
        f"energy: {{kinetic: '{kinetic}', potential: '{draw(of_positions)}'}}",
        f"forces: {{x: '{draw(expressions)}'}}" if draw(st.booleans()) else "",
        "constraints:" if rows else "", *(f"  c{k}: '{r}'" for k, r in enumerate(rows)),
        f"initial: {{x: {draw(numbers)}, y: {draw(numbers)}, x_dot: {draw(numbers)}}}",
        f"simulation: {{duration: {draw(numbers)}}}" if draw(st.booleans()) else "",
        "scene: {points: {a: [p, x], b: [0, y]}, links: [[a, b]]}",
    ]  # fmt: skip
    text = "\n".join(lines)
    if draw(st.integers(0, 9)) == 7:
        at = draw(st.integers(0, 10**6)) % len(text)
        text = text[:at] + draw(st.sampled_from(RUBBISH)) + text[at + 1 :]
    return text


options = st.sampled_from(
    (
        ("check",), ("check",), ("check", "--json"), ("derive",), ("derive", "--solve"),
        ("derive", "--format", "latex"), ("derive", "--format", "json", "--gauss"),
        ("derive", "--format", "python"), ("check", "--set", "k=1e200"),
        ("check", "--set", "k=nan"), ("check", "--set", "k="),
    )
)  # fmt: skip
