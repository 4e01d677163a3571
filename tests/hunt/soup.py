"""Endless cases for the command: expressions, files and command lines, by number.

Each case follows from a seed and its number alone, so that a failing case can be made
again; it is made small, and stored in a file.
"""

from __future__ import annotations

import random
import re
from typing import TYPE_CHECKING, NamedTuple

import typer.main

from lagsim.cli import _application
from tests.support import MODELS

if TYPE_CHECKING:
    from collections.abc import Callable

# Numbers that doubles can hardly hold, and functions that are defined almost nowhere.
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

MODEL = """\
parameters: {k: 2, m: 1}
coordinates: {x: {unit: m}, y: {unit: m}}
definitions: {p: 'x + y'}
energy: {kinetic: m*(x_dot^2 + y_dot^2)/2, potential: 'k*x^2'}
forces: {x: '-y_dot'}
constraints: {c: 'x - y = 0'}
initial: {x: '1', y: x}
simulation: {duration: 0.01, output_step: 0.01}
"""
# What an expression may stand in for.
PLACES = ("x + y", "k*x^2", "-y_dot", "x - y = 0", "'1'", "0.01")
WORDS = (
    *NAMES, *NUMBERS, "+", "-", "*", "/", "^", "(", ")", ",", "=", "<", ">=", "if(",
    "sin(", "min(", "hypot(", " and ", " not ", "x_ddot", "lambda_c", "q", "2 x", "'",
)  # fmt: skip
LINES = (
    "- 1", "? a", "<<: {a: 1}", "x: &a 1", "y: *a", "a: !!float 1", "---", "\tx: 1",
    "constraints: {d: 'x >= 0'}", "initial: {x: {guess: 1}}", "output: {columns: [p]}",
    "scene: {points: {a: [p, x]}, links: [[a, a]]}", "simulation: {until: 'x = 0'}",
    "lagsim: 1", "name: ''", "output: {plots: [{x: t, y: [x, p]}], reactions: [p]}",
)  # fmt: skip
SHIPPED = [path.read_text("utf-8") for path in sorted(MODELS.rglob("*.yaml"))]
# What options are given; files are those of `FILES`, or none.
VALUES = (
    *NUMBERS, "", "-1", "nan", "inf", "x", "k=1", "k=", "=", "k=1e200", "auto", "rk4",
    "radau", "taylor", "1:2", "1:2:3", "k=1:2:2", "a:b", "1e-3:1e-5", "out", "m.yaml",
    "no/such/file", ".", "..", "-", "--", "x,y", "\u202e", "é", "a" * 300, "%s", "E104",
)  # fmt: skip
FILES = ("m.yaml", "-", "bad.yaml", "none.yaml", "out", "table.csv", "/dev/null", "")
# Measuring takes long: these get no model that could be measured.
LONG = ("bench", "stability")
# They would ask a network, wait for input, or start processes.
KEPT = ("--dask", "--jobs", "-j", "--install-completion", "--show-completion")


class Case(NamedTuple):
    """A command line, and the file `m.yaml` that it may name."""

    line: tuple[str, ...]
    text: str


def case(seed, number):
    """Return a case: of ten, five are expressions, four files, one a command line."""
    rng = random.Random(f"{seed} {number}")
    kind = number % 10
    if kind < 5:
        old = rng.choice(PLACES)
        quoted = '"' + expression(rng).replace("\\", "").replace('"', "") + '"'
        new = quoted if old == "0.01" or old[0] == "'" else quoted[1:-1]
        return Case(("check", "m.yaml"), MODEL.replace(old, new, 1))
    if kind < 7:
        return Case(rng.choice(OF_FILES), mutated(rng))
    if kind < 9:
        return Case(rng.choice((*OF_FILES, *OF_WRITTEN)), written(rng))
    return Case(command_line(rng), MODEL)


OF_FILES = (
    ("check", "m.yaml"), ("check", "m.yaml", "--json"), ("check", "m.yaml", "--repair"),
    ("check", "m.yaml", "--set", "k=1e200"),
)  # fmt: skip
SHORT = ("-o", "out", "--no-plots", "--error-bar", "never", "--duration", "0.01",
         "--output-step", "0.001", "-q")  # fmt: skip
OF_WRITTEN = (
    ("run", "m.yaml", *SHORT), ("run", "m.yaml", *SHORT, "--animate"),
    ("run", "m.yaml", *SHORT, "--method", "radau"), ("derive", "m.yaml"),
    ("derive", "m.yaml", "--solve"), ("derive", "m.yaml", "--format", "latex"),
    ("derive", "m.yaml", "--format", "json", "--gauss"),
    ("derive", "m.yaml", "--format", "python"), ("check", "m.yaml", "--set", "k="),
)  # fmt: skip


def expression(rng):
    """Return an expression that is grown, or a random sequence of words."""
    if rng.random() < 0.3:
        return "".join(rng.choice(WORDS) for _ in range(rng.randint(1, 12)))
    grown = _grown(rng, rng.randint(0, 4))
    if rng.random() < 0.1:
        at = rng.randrange(len(grown))
        grown = grown[:at] + rng.choice(RUBBISH) + grown[at + 1 :]
    return f"{grown} = {_grown(rng, 1)}" if rng.random() < 0.1 else grown


def _grown(rng, depth):
    if depth == 0:
        return rng.choice(NAMES if rng.random() < 0.6 else NUMBERS)
    form = rng.choice(CALLS)
    holes = [_grown(rng, rng.randrange(depth)) for _ in range(form.count("{}"))]
    return form.format(*holes)


def written(rng):
    """Return a model by a grammar of the file, sometimes with a wrong letter."""

    def grown(*more):
        names = rng.choice((*more, "x", "y", "x", "y", "t", "k", number()))
        return names if rng.random() < 0.5 else _grown(rng, rng.randint(1, 2))

    def number():
        plain = ("1", "2", "0.5", "-1", "3", "0")
        return rng.choice(plain if rng.random() < 0.7 else NUMBERS)

    inertia = [rng.choice(("1", "1", "2", "k", "0", "1e200", "x")) for _ in "xy"]
    kinetic = f"{inertia[0]}*x_dot^2/2 + {inertia[1]}*y_dot^2/2"
    kinetic += f" + {grown('x_dot')}" if rng.random() < 0.3 else ""
    signs = ("=", ">=", "<=", "= x +")
    laws = [f"  c{k}: '{grown()} {rng.choice(signs)} {grown('y_dot')}'"
            for k in range(rng.randint(0, 3))]  # fmt: skip
    text = "\n".join((
        f"parameters: {{k: {number()}}}",
        "coordinates: {x: {}, y: {unit: m}}",
        f"definitions: {{p: '{grown()}'}}",
        f"energy: {{kinetic: '{kinetic}', potential: '{grown()}'}}",
        f"forces: {{x: '{grown('x_dot', 'p')}'}}" if rng.random() < 0.5 else "",
        "constraints:" if laws else "", *laws,
        f"initial: {{x: {number()}, y: {number()}, x_dot: {number()}}}",
        f"simulation: {{duration: {number()}}}" if rng.random() < 0.5 else "",
        "scene: {points: {a: [p, x], b: [0, y]}, links: [[a, b]]}",
    ))  # fmt: skip
    return _letter(rng, text) if rng.random() < 0.1 else text


def mutated(rng):
    """Return a shipped model with a few faults."""
    text = rng.choice(SHIPPED)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        text = rng.choice(CHANGES)(rng, text)
    return text


def _letter(rng, text):
    at = rng.randrange(len(text) + 1)
    new = rng.choice(("", "", rng.choice(RUBBISH), rng.choice("aex01_")))
    return text[:at] + new + text[at + rng.randrange(2) :]


def _line(rng, text):
    lines = text.split("\n")
    at = rng.randrange(len(lines))
    new = rng.choice((lines[rng.randrange(len(lines))], rng.choice(LINES)))
    lines[at : at + rng.randrange(3)] = [rng.choice(("", "  ", "      ")) + new]
    return "\n".join(lines)


def _word(rng, text):
    words = list(re.finditer(r"[\w.]+", text))
    if not words:
        return text
    found = rng.choice(words)
    new = rng.choice((rng.choice(words)[0], rng.choice(WORDS), expression(rng)))
    return text[: found.start()] + new + text[found.end() :]


def _cut(rng, text):
    first, last = sorted(rng.randrange(len(text) + 1) for _ in range(2))
    return text[:first] + text[last if rng.random() < 0.5 else first + 30 :]


CHANGES: tuple[Callable[[random.Random, str], str], ...] = (
    _letter, _letter, _line, _word, _word, _word, _cut,
)  # fmt: skip


def _options():
    """Return the options of each command, and whether they take a value."""
    group = typer.main.get_command(_application())
    found = {}
    for name, command in group.commands.items():  # type: ignore[attr-defined]
        found[name] = [
            (option, not getattr(param, "is_flag", False))
            for param in command.params
            for option in param.opts
            if option.startswith("-") and option not in KEPT
        ]
    return found


OPTIONS = _options()


def command_line(rng):
    """Return a command with arguments and options, few of which are sensible."""
    name = rng.choice((*OPTIONS, "check", "derive", "run", "--help", "nonsense"))
    words = [name]
    known = [*OPTIONS.get(name, ()), ("--nonsense", True), ("-q", False)]
    files = FILES[2:] if name in LONG else FILES
    words += [
        rng.choice(files if rng.random() < 0.8 else NUMBERS)
        for _ in range(rng.choice((0, 1, 1, 1, 2)))
    ]
    for _ in range(rng.choice((0, 1, 1, 2, 4))):
        option, takes = rng.choice(known)
        words.append(option)
        if takes and rng.random() < 0.95:
            words.append(rng.choice(NUMBERS if name in LONG else VALUES))
    if name in ("run", "golden", "sweep"):
        words.append("--no-plots" if name == "run" else "-q")
    return tuple(words)
