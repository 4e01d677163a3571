"""What a kernel may not hold: file, line, and what to write instead."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

import pytest

from lagsim.native.kernels.code import KernelError, translate
from tests.native.test_kernel_code import module

if TYPE_CHECKING:
    from pathlib import Path

HEAD = """from __future__ import annotations
import math
from math import hypot, isnan, sqrt
from lagsim.native.kernels import words
from lagsim.language.arrays import Floats
from lagsim.native.kernels.words import at, external, total, unrolled
TABLE = (1.0, 2.0)
ROWS = {}
N = 2
"""


# The body of `f`, where `!` marks the line at fault, and what the message says.
FAULTS = [
    ("!return sum([x])", "write total"),
    ("!return len(a)", "pass the length"),
    ("!return hypot(x, x)", r"sqrt\(x\*x \+ y\*y\)"),
    ("!return at(a[1:], 1)[0]", r"at\(a, k\)"),
    ("!return n ** 2 + x", "write the product"),
    ("k = 1\n!k = x\nreturn x", r"`k`, which began as int, is float.*int\(\.\.\.\)"),
    ("!if n:\n    return x\nreturn x", "not a condition"),
    ("if x > 0:\n    y = x\n!return y", "`y` may be without a value"),
    ("!return", "returns nothing"),
    ("!return x > 0", "bool, not float"),
    ("!return missing(x)", "`missing` is not defined"),
    ("!return ROWS[n]", "global `ROWS` is dict"),
    ("!return TABLE[N]", "index 2 of 2"),
    ("!return a[-1]", "count from 0"),
    ("!return x[0]", "`x`, which is indexed, is float, not Floats"),
    ("!return a[x]", "index is float, not int"),
    ("!for i in a:\n    pass\nreturn x", r"apart\(n\) or unrolled"),
    ("!for i in range(0, 3, 0):\n    pass\nreturn x", "step is zero"),
    ("!for i in unrolled(n):\n    pass\nreturn x", "not known at translation"),
    ("for i in unrolled(2):\n!    i = 3\nreturn x", "counts an unrolled loop"),
    ("!return total(x for i in range(3))", r"unrolled\(\.\.\.\)"),
    ("!while x > 1:\n    x -= 1\nelse:\n    x = 1\nreturn x", "no else"),
    ("!a, x = 1, 2, 3\nreturn x", "same number"),
    ("!g(x, n=1)\nreturn x", "positional"),
    ("!return g(x, x)", "takes 1 arguments here, not 2"),
    ("!return g(a)", "argument `x` of g is Floats, not float"),
    ("!return -a", "is Floats, not a number"),
    ("!x is None\nreturn x", "does nothing"),
    ("!assert x > 0\nreturn x", "return a status"),
    ("!return 10**30 + n + x", "does not fit 64 bits"),
    ("!return TABLE[0] / 0", "division by zero"),
    ("!y: float = x\nreturn y", "gives its kind"),
    ("!return x % 2", "of integers"),
    ("!return x if isnan(x) else -x", "write x != x"),
    ("!return n if n > 1 else x", "values is float, not int"),
    ("!x = -at\nreturn x", "globals are int"),
    ("!return x(n)", "`x` is a variable"),
    ("!return math.nothing(x)", "only modules have attributes"),
    ("!return total(x for i, j in unrolled(2))", "is one name"),
    ("!return x if x == x == (n > 1) else x", "compares bool"),
    ("!if N and x > 0:\n    return x\nreturn x", "no condition"),
    (
        "for i in range(n):\n    pass\n!for i in unrolled(2):\n    pass\nreturn x",
        "taken",
    ),
    ("!x = nothing()\nreturn x", "`x` is given no value"),
    ("!x.y = 2.0\nreturn x", "takes no value"),
]


def fault_of(tmp_path: Path, text: str) -> KernelError:
    loaded = module(tmp_path / "faulty.py", text)
    with pytest.raises(KernelError) as caught:
        translate([loaded.f])
    return caught.value


@pytest.mark.parametrize(("body", "message"), FAULTS)
def test_faults_name_line_and_remedy(tmp_path: Path, body: str, message: str) -> None:
    head = (
        HEAD
        + "def nothing() -> None:\n    pass\ndef g(x: float) -> float:\n    return x\n"
    )
    head += "def f(x: float, n: int, a: Floats) -> float:\n"
    lines = body.splitlines()
    [marked] = [i for i, line in enumerate(lines) if line.startswith("!")]
    text = head + "".join(f"    {line.removeprefix('!')}\n" for line in lines)
    fault = fault_of(tmp_path, text)
    where = f"{tmp_path / 'faulty.py'}:{head.count(chr(10)) + 1 + marked}: in `f`: "
    assert str(fault).startswith(where)
    assert fault.args[0].count("\n") == 0
    assert re.search(message, str(fault))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("def f(x) -> int:\n    return 1\n", "parameter `x` has no annotation"),
        ("def f(x: list) -> int:\n    return 1\n", "has list"),
        ("def f(x: int):\n    return 1\n", "the result has no annotation"),
        ("def f(x: int = 1) -> int:\n    return x\n", "no default"),
        ("def f(*x: int) -> int:\n    return 1\n", "positional"),
        ("def f(x: int) -> int:\n    if x > 0:\n        return 1\n", "may end without"),
        ("def f(x: Floats) -> Floats:\n    return x\n", "gives no array"),
        ("def f(x: None) -> int:\n    return 1\n", "is None"),
        ("def f(x: Floats, /) -> 'Floats':\n    return x\n", "gives no array"),
        ("def fü() -> int:\n    return 1\nf = fü\n", "ASCII"),
        ("f = lambda x: x\n", "made by `def`"),
    ],
)
def test_faults_of_signatures(tmp_path: Path, text: str, message: str) -> None:
    fault = fault_of(tmp_path, HEAD + text)
    assert f"faulty.py:{HEAD.count(chr(10)) + 1}: " in str(fault)
    assert message in str(fault)


def test_a_kernel_has_no_surroundings() -> None:
    outer = 3.0

    def f(x: float) -> float:
        return x * outer

    with pytest.raises(KernelError, match="outer of an enclosing function"):
        translate([f])
    with pytest.raises(KernelError, match="made by `def`"):
        translate([math.sqrt])


def test_a_kernel_has_a_text() -> None:
    names: dict[str, object] = {}
    # a file name of its own: since Python 3.13 a process of `python -c` has a text
    # for "<string>"
    exec(compile("def f() -> int:\n    return 1\n", "<made here>", "exec"), names)
    with pytest.raises(KernelError, match="source text is not there"):
        translate([names["f"]])
