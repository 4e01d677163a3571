"""Model files of 100 kB that nobody would write: each makes one part very large."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

LETTERS = 100_000


def model(
    kinetic="x_dot^2/2",
    potential="0",
    *,
    coordinates="x",
    parameters="k: 2",
    more="",
):
    """Return a model whose coordinates, named with blanks between, begin at 1."""
    names = coordinates.split()
    return "\n".join(
        [
            f"parameters: {{{parameters}}}",
            f"coordinates: {{{', '.join(f'{name}: {{}}' for name in names)}}}",
            f'energy: {{kinetic: "{kinetic}", potential: "{potential}"}}',
            f"initial: {{{', '.join(f'{name}: 1' for name in names)}}}",
            "simulation: {duration: 1}",
            more,
        ]
    )


def _sum(form, letters, sign="+"):
    """Return a sum of terms with the numbers 1, 2, 3 ... in place of @."""
    many = letters // (len(form) + 3)
    return sign.join(form.replace("@", str(k)) for k in range(1, many))


def _nested(before, inner, after, letters):
    many = letters // (len(before) + len(after))
    return before * many + inner + after * many


def _entries(form, letters, separator="\n"):
    return _sum(form, letters, separator)


def _q(letters, form):
    """Return coordinates, and a sum with a term for each."""
    many = letters // (2 * len(form) + 12)
    names = [f"q{k}" for k in range(many)]
    return " ".join(names), "+".join(form.replace("@", name) for name in names)


def _coupled(letters, whole, form):
    names, total = _q(letters, form)
    squares = "+".join(f"{name}_dot^2" for name in names.split())
    return model(f"{whole.replace('@', total)} + {squares}", coordinates=names)


def _constraints(letters, count, form, by):
    """Return constraints on `count` names each, which replace @ in `form`."""
    names = [f"q{k}" for k in range(count)]
    whole = by.join(form.replace("@", name) for name in names)
    many = max(2, letters // (len(whole) + 12))
    lines = [f"  c{j}: {whole.replace('$', str(j))} = 1" for j in range(many)]
    squares = "+".join(f"{name}_dot^2" for name in names)
    more = "\n".join(["constraints:", *lines])
    return model(squares, coordinates=" ".join(names), more=more)


def _definitions(letters, form, first="x"):
    """Return definitions; each previous name replaces @ in `form`."""
    many = letters // (2 * len(form) + 8)
    lines = ["definitions:", f"  d0: {first}"]
    lines += [f"  d{k}: '{form.replace('@', f'd{k - 1}')}'" for k in range(1, many)]
    return model(potential=f"d{many - 1}", more="\n".join(lines))


def rods(count, length):
    """Return rods of length 1 in a row; neighbouring ends begin `length` apart."""
    names = [f"{x}{k}" for k in range(1, count + 1) for x in "xy"]
    lines = [
        f"  c{k}: (x{k} - x{k - 1})^2 + (y{k} - y{k - 1})^2 = 1"
        for k in range(2, count + 1)
    ]
    whole = model(
        "+".join(f"{name}_dot^2" for name in names), coordinates=" ".join(names),
        more="\n".join(["constraints:", "  c1: x1^2 + y1^2 = 1", *lines]),
    )  # fmt: skip
    for k in range(1, count + 1):
        whole = whole.replace(f"x{k}: 1, y{k}: 1", f"x{k}: {k * length}, y{k}: 0")
    return whole


SHAPES: dict[str, Callable[[int], str]] = {
    "parentheses": lambda n: model(potential=_nested("(", "x", ")", n)),
    "calls in calls": lambda n: model(potential=_nested("sin(x + ", "x", ")", n)),
    "signs": lambda n: model(potential=_nested("-", "x", "", n)),
    "conditions": lambda n: model(potential=_nested("if(x > 1, x^2, ", "0", ")", n)),
    "a tower": lambda n: model(potential=_nested("x^", "2", "", n)),
    "squares of squares": lambda n: model(potential=_nested("(", "x", ")^2", n)),
    "a fraction": lambda n: model(potential=_nested("1/(x + ", "1", ")", n)),
    "a sum": lambda n: model(potential=_sum("sin(@*x)", n)),
    "a product": lambda n: model(potential=_sum("(1 + x/@)", n, "*")),
    "switches": lambda n: model(potential=_sum("if(x > @, x, 0)", n)),
    "digits": lambda n: model(potential=f"0.{'123456789' * (n // 9)}*x"),
    "a long name": lambda n: model(
        potential=f"{'a' * (n // 9)}*x", parameters=f"? {'a' * (n // 9)}\n  : 2"
    ),
    "definitions twice": lambda n: _definitions(n, "@ + @"),
    "definitions squared": lambda n: _definitions(n, "@*@ + 1"),
    "parameters": lambda n: model(parameters="k: 1, " + _entries("p@: @", n, ", ")),
    "one sum of all velocities": lambda n: _coupled(n // 2, "(@)^2", "@_dot"),
    "turning sums": lambda n: _coupled(n // 2, "(@)^2", "sin(@)*@_dot"),
    "products of all": lambda n: _constraints(n, 100, "(@ + $)", "*"),
    "sines of all": lambda n: _constraints(n, 100, "sin(@ + $)", "+"),
    "constraints of two": lambda n: _constraints(n, 2, "@", "*"),
    "a product of sines": lambda n: model(
        "x_dot^2 + d_dot^2", more=f"definitions:\n  d: '{_sum('sin(x*@)', n, '*')}'"
    ),
    "turning velocities": lambda n: _coupled(n // 8, "(@)^2", "@_dot*cos(@)"),
    "equal constraints": lambda n: model(
        "x_dot^2 + y_dot^2", coordinates="x y",
        more="constraints:\n" + _entries("  c@: x = y", n),
    ),
    "contacts": lambda n: model(
        "x_dot^2 + y_dot^2", coordinates="x y", more="constraints:\n"
        + _entries("  c@: {relation: x >= -@, restitution: 0.5}", n),
    ),
    "points": lambda n: model(
        more="scene:\n  points:\n" + _entries("    p@: [x, '@*x']", n)
    ),
    "plots": lambda n: model(
        more="output:\n  plots:\n" + "    - {x: x, y: x_dot}\n" * (n // 30)
    ),
    "unknown names": lambda n: model(potential=_sum("u@", n)),
    "aliases": lambda n: _entries("a@: &a@ [*a1, *a1]", n),
    "keys": lambda n: ": ".join("a" * (n // 3)),
    "dashes": lambda n: "- " * (n // 2),
    "braces": lambda n: "x-a: " + "{a: " * (n // 4),
    "commas": lambda n: "x-a: [" + "(," * (n // 2) + "]",
    "a key again": lambda n: "a: 1\n" * (n // 5),
    "texts with two colons": lambda n: _entries("k@: -y: 3", n),
    "a ring": lambda n: _definitions(n, "@", f"d{n // 10 - 1}"),
}  # fmt: skip
"""Each gives a text of about so many letters."""

# What sympy would not come to the end of.
ENDLESS = {
    "an exact power": model(potential="(x/2)^10000000000"),
    "a tower of numbers": model(potential="10^10^10*x"),
    "a power of a power": model(potential="(((x/3)^900)^900)^900"),
    "a logarithm in exp": model(potential="exp(10000000000*log(x/2))"),
    "a number too long to print": model(potential="2^2^2^2^2*x"),
}
