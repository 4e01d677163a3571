"""The parser: precedence, every fault with its place and hint, depth and length."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lagsim.language.evaluate import evaluate
from lagsim.language.functions import FUNCTIONS
from lagsim.language.graph import Graph
from lagsim.language.parser import ExpressionError, parse, parse_relation

VALUES = {"x": 3.0, "y": -2.0, "z": 0.5, "min": 7.0, "E": 11.0, "lambda": 13.0}


def value(text):
    g = Graph()
    return evaluate(g, [parse(text).build(g, g.variable)], VALUES)[0]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("-x^2", -9.0), ("(-x)^2", 9.0), ("2^-1", 0.5), ("2^3^2", 512.0),
        ("(2^3)^2", 64.0), ("2**3**2", 512.0), ("2**3^2", 512.0), ("2^-1^2", 0.5),
        ("2^-x*4", 0.5), ("2^-2^-1", 2 ** -(2**-1)), ("-2^-2", -0.25), ("2*-3", -6.0),
        ("2--3", 5.0), ("2+-3", -1.0), ("--3", 3.0), ("-+-3", 3.0), ("+x", 3.0),
        ("-x*y", 6.0), ("x - y - z", 4.5), ("x - (y - z)", 5.5), ("12/3/2", 2.0),
        ("12/(3/2)", 8.0), ("12/3*2", 8.0), ("2*3^2", 18.0), ("1 + 2*3", 7.0),
        ("(1 + 2)*3", 9.0), ("-x - -y", -5.0), ("x^2/2", 4.5), ("2*x^2*z", 9.0),
        ("1e3 + .5 + 1. + 1E-1", 1001.6), ("if(x > 2, 1, 2)", 1.0),
        ("if(x >= 3 and y < 0, 1, 2)", 1.0),
        ("if(not x < 2 and y > 0 or z > 0, 1, 2)", 1.0),
        ("if(not (x > 2 or y > 0), 1, 2)", 2.0),
        ("if(x > 4 or x > 2 and y > 0, 1, 2)", 2.0),  # `and` binds tighter
        ("if(not x > 4, 1, 2)", 1.0),  # `not` binds weaker than a comparison
        ("if(not not x > 4, 1, 2)", 2.0), ("if((x > 2), 1, 2)", 1.0),
        ("if(x + 1 <= 2*2, 1, 2)", 1.0), ("if(-x < y, 1, 2)", 1.0),
        ("atan2(1, 1)", math.pi / 4), ("hypot(x, 4)", 5.0), ("max(min(x, 1), y)", 1.0),
        ("sin (0)", 0.0),
        ("min + min(x, min)", 10.0),  # two namespaces
        ("E + lambda", 24.0), (" x\n +\ty ", 1.0), ("((x))", 3.0), ("sin((0))", 0.0),
        ("max((x), (y))", 3.0), ("abs(-(x))", 3.0),
    ],
)  # fmt: skip
def test_precedence_and_associativity(text, expected):
    assert value(text) == pytest.approx(expected, rel=1e-15)


def fault(text):
    with pytest.raises(ExpressionError) as caught:
        parse(text)
    return caught.value


# text, offset, length, a part of the message, a part of the hint
FAULTS = [
    ("", 0, 1, "found nothing", ""),
    ("   ", 3, 1, "found nothing", ""),
    ("x +", 3, 1, "ends where a value is expected", ""),
    ("x + * y", 4, 1, "a value is expected before `*`", ""),
    ("*x", 0, 1, "a value is expected before `*`", ""),
    ("()", 1, 1, "a value is expected before `)`", ""),
    ("sin()", 4, 1, "a value is expected before `)`", "`sin` takes 1 argument"),
    ("sin(", 4, 1, "ends where a value is expected", ""),
    ("max(1,)", 6, 1, "a value is expected before `)`", "`max` takes 2 arguments"),
    ("max(,1)", 4, 1, "a value is expected before `,`", ""),
    ("(x", 0, 1, "never closed", ""),
    ("2*sin(x", 2, 3, "never closed", ""),
    ("x)", 1, 1, "never opened", ""),
    ("(x, y)", 2, 1, "a comma is allowed only between", "`.`"),
    ("1,5", 1, 1, "a comma is allowed only between", "`.`"),
    ("2 pi", 2, 2, "an operator is expected between `2` and `pi`", "write `*`"),
    ("x y", 2, 1, "an operator is expected between `x` and `y`", "write `*`"),
    ("q.3 + 1", 1, 2, "an operator is expected between `q` and `.3`", "is q(3)"),
    ("(x)(y)", 3, 1, "an operator is expected", "write `*`"),
    ("x(y)", 0, 1, "no function `x`", ""),
    ("2(x)", 1, 1, "an operator is expected", "write `*`"),
    ("sine(x)", 0, 4, "no function `sine`", "did you mean `sin`?"),
    ("1 + arctan(x)", 4, 6, "no function `arctan`", "did you mean `atan"),
    ("sqrt(x, y)", 0, 4, "`sqrt` takes 1 argument, found 2", ""),
    ("atan2(x)", 0, 5, "`atan2` takes 2 arguments, found 1", ""),
    ("if(x > 0, 1)", 0, 2, "if(condition, a, b), found 2", ""),
    ("max(x, y, z)", 0, 3, "takes 2 arguments, found 3", ""),
    ("2x", 0, 2, "`2x` is not a number", "`*`"),
    ("1_000", 0, 5, "`1_000` is not a number", "write 1000"),
    ("0x10", 0, 4, "`0x10` is not a number", "decimal"),
    ("1e", 0, 2, "`1e` is not a number", ""),
    ("1.2.3", 3, 2, "an operator is expected", ""),
    ("x + 1e400", 4, 5, "too large to be finite", "1.8e308"),
    ("x = 1", 2, 1, "`=` has no meaning here", "constraints"),
    ("= 1", 0, 1, "`=` has no meaning here", "leave `=` out"),
    ("x == 1", 2, 2, "`==` is no operator", "in `if`"),
    ("if(x != 1, 1, 2)", 5, 2, "`!=` is no operator", "in `if`"),
    ("if(x <> 1, 1, 2)", 5, 2, "`<>` is no operator", "in `if`"),
    ("if(x > 1 && y > 0, 1, 2)", 9, 2, "`&&` is no operator", "`and`"),
    ("if(x > 1 || y > 0, 1, 2)", 9, 2, "`||` is no operator", "`or`"),
    ("x > 0", 0, 1, "a comparison is allowed only in `if`", "if(condition"),
    ("1 + (x > 0)", 5, 1, "a comparison is allowed only in `if`", "if(condition"),
    ("-(x > 0)", 2, 1, "a comparison is allowed only in `if`", "if(condition"),
    ("sin(x > 0)", 4, 1, "a comparison is allowed only in `if`", "if(condition"),
    ("if(x > 0, y > 0, 1)", 10, 1, "a comparison is allowed only in `if`", ""),
    ("(x > 0) > 1", 1, 1, "a comparison is allowed only in `if`", ""),
    ("if(x, 1, 2)", 3, 1, "`if` expects a comparison here", "x > 0"),
    ("if(x and y > 0, 1, 2)", 3, 1, "`and` expects a comparison here", "x > 0"),
    ("if(not x, 1, 2)", 7, 1, "`not` expects a comparison here", "x > 0"),
    ("if(0 < x < 1, 1, 2)", 9, 1, "comparisons do not chain", "a < b and b < c"),
    ("if(0 < x <= 1, 1, 2)", 9, 2, "comparisons do not chain", "a < b and b < c"),
    ("not", 3, 1, "ends where a value is expected", ""),
    ("x not y", 2, 3, "an operator is expected", ""),
    ("and x", 0, 3, "a value is expected before `and`", ""),
    ("_x", 0, 1, "begins with a letter", ""),
    ("x²", 0, 2, "not in its plain (NFKC) form", "write `x^2`"),
    ("1 + ﬁeld", 4, 4, "not in its plain (NFKC) form", "write `field`"),
    ("x − y", 2, 1, "unexpected character", "plain minus"),
    ("x × y", 2, 1, "unexpected character", "write `*`"),
    ("x ≤ y", 2, 1, "unexpected character", "write `<=`"),
    ("x % y", 2, 1, "unexpected character", "mod"),
    ("[x]", 0, 1, "unexpected character", "parentheses"),
    ("x; y", 1, 1, "unexpected character", "no sign after the last"),
    ("x'", 1, 1, "unexpected character", "q_dot"),
    ('"x"', 0, 1, "unexpected character", "quotes"),
    ("x!", 1, 1, "unexpected character", "`not`"),
    ("x $ y", 2, 1, "unexpected character '$'", ""),
    ("x ＋ y", 2, 1, "unexpected character", "'+'"),
    ("x.y", 1, 1, "unexpected character '.'", ""),
    ("x\0", 1, 1, "unexpected character", ""),
]


@pytest.mark.parametrize(("text", "offset", "length", "message", "hint"), FAULTS)
def test_faults(text, offset, length, message, hint):
    found = fault(text)
    assert (found.offset, found.length) == (offset, length)
    assert message in found.text
    assert hint in found.hint


def test_every_function_of_the_table_can_be_called():
    for name, row in FUNCTIONS.items():
        args = ["x"] * row.arity
        if name == "if":
            args[0] = "x > 0"
        parse(f"{name}({', '.join(args)})")
        with pytest.raises(ExpressionError, match="takes"):
            parse(f"{name}({', '.join([*args, 'x'])})")


@pytest.mark.parametrize("name", ["add", "neg", "lt", "and_", "constant", "variable"])
def test_the_operators_rows_cannot_be_called(name):
    assert "there is no function" in fault(f"{name}(x)").text


def relation(text):
    parsed = parse_relation(text)
    g = Graph()
    sides = [side for side in (parsed.left, parsed.right) if side]
    found = evaluate(g, [side.build(g, g.variable) for side in sides], VALUES)
    return found[0], found[1] if parsed.right else None, parsed.sense


def test_relations():
    assert relation("x^2 = y + 1") == (9.0, -1.0, "=")
    assert relation("x <= -y") == (3.0, 2.0, "<=")
    assert relation("x >= 0") == (3.0, 0.0, ">=")
    assert relation("x - y") == (5.0, None, "=")
    assert relation("if(x <= 1, 2, 3) = 3") == (3.0, 3.0, "=")
    names = parse_relation("x = y + x").names
    assert [(n.text, n.offset) for n in names] == [("x", 0), ("y", 4), ("x", 8)]


@pytest.mark.parametrize(
    ("text", "offset", "message", "hint"),
    [
        ("x < 1", 2, "a relation is not strict", "write `<=`"),
        ("x > 1", 2, "a relation is not strict", "write `>=`"),
        ("x = y = 1", 6, "a relation has one", "two constraints"),
        ("0 <= x <= 1", 7, "a relation has one", "two constraints"),
        ("x <= 1 and y >= 0", 13, "a relation has one", "1, 0) >= 1"),
        ("= 1", 0, "found nothing", ""), ("x =", 3, "found nothing", ""),
        ("", 0, "found nothing", ""), ("(x = 1)", 3, "`=` has no meaning here", ""),
        ("(x <= 1)", 1, "a comparison is allowed only in `if`", ""),
        ("(x = 1", 3, "`=` has no meaning here", ""),
        ("x) = 1", 1, "never opened", ""),
        ("x + = 1", 4, "ends where a value is expected", ""),
        ("x = 1 +", 7, "ends where a value is expected", ""),
        ("x = * 1", 4, "a value is expected before `*`", ""),
        ("if(x = 1, 2, 3) = 2", 5, "`=` has no meaning here", ""),
    ],
)  # fmt: skip
def test_faults_of_relations(text, offset, message, hint):
    with pytest.raises(ExpressionError) as caught:
        parse_relation(text)
    assert caught.value.offset == offset
    assert message in caught.value.text
    assert hint in caught.value.hint


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [("(", ")", 0.25), ("abs(", ")", 0.25), ("-", "", 0.25), ("2^0*(", ")", 0.25)],
)
def test_depth_is_no_limit(before, after, expected):
    g = Graph()
    node = parse(before * 2000 + "x" + after * 2000).build(g, g.variable)
    assert evaluate(g, [node], {"x": 0.25}) == [expected]


@pytest.mark.slow
def test_unbalanced_depth_is_a_fault():
    assert fault("(" * 2000 + "x" + ")" * 1999).offset == 0
    assert fault("(" * 1999 + "x" + ")" * 2000).offset == 3999
    assert fault("sin(" * 2000).offset == 8_000


@pytest.mark.slow
@given(st.text(alphabet="xy12.eE+-*/^()<>=, andortif_²\n", max_size=30))
@settings(max_examples=300, deadline=None)
def test_any_text_parses_or_is_refused_in_its_place(text):
    for read in (parse, parse_relation):
        faults = []
        try:
            read(text)
        except ExpressionError as found:
            faults.append(found)
        for found in faults:
            assert 0 <= found.offset <= len(text)
            assert found.length >= 1
            assert found.offset + found.length <= len(text) + 1
            assert found.text
