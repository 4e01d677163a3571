"""Equations for readers: the output of `lagsim derive`.

sympy is loaded by this package alone, and not for the format `python`, which is written
straight from the graph.

    equations -> lagrange (graph, then sympy) -> content, tidy -> text, latex, printers
    sums over members (elements) -> members
    equations -> as_python

This module holds a derivation as sympy expressions, and the conditions of constraints
as statements; a style supplies its signs and its names of gap and rate.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.model.model import Constraint, Model
    from lagsim.show.printers import Printer
    from lagsim.show.symbols import Translation


class Content(NamedTuple):
    """A derivation.

    Attributes
    ----------
    translation
        The model, and how its symbols are shown.
    document
        The content of the JSON output, by the keys of docs/derive.md, with sympy
        expressions in place of texts. Two keys differ: `gauss.a` is the tuple of the n
        accelerations, and `conditions` is added by each format.
    """

    translation: Translation
    document: dict[str, Any]


# Equations of more coordinates and constraints, whose matrices would fill pages, are
# given in the definitions of the file, see `separation`.
MOST_ROWS = 20


def has_many_rows(model: Model) -> bool:
    """Whether the matrices of a model have too many rows to be read by a person."""
    return len(model.coordinates) + len(model.constraints) > MOST_ROWS


UNICODE = {
    "complementarity": "0 ≤ {g} ⊥ {lam} ≥ 0",
    "impact": "{rate}⁺ = −{e} {rate}⁻",
    "poisson": "Λ_e ≥ {e} Λ_c, {rate}⁺ ≥ 0, where Λ_c ends the approach",
    "inelastic": "{rate}⁺ = 0",
    "friction": "|f| ≤ {bound}, against the slip",
    "sticking": "|f| ≤ {most} while it sticks; |f| = {bound} against the slip",
    "limit": "|{lam}| ≤ {static_limit} while it holds; |{lam}| = {limit} against the "
    "slip",
    "when": "{lam} = 0 unless {when}",
}
_PLAIN = {
    "−": "-", "≥": ">=", "≤": "<=", "⊥": "_|_", "∂": "d", "Σ": "sum", "q̇": "q'",
    "q̈": "q''", "⁻¹": "^-1", "⁺": "+", "⁻": "-", "ᵀ": "^T", "²": "^2", "λ": "lambda",
    "Λ": "Lambda",
}  # fmt: skip


def in_ascii(signs: Mapping[str, str]) -> dict[str, str]:
    """Return the signs of a style, with signs that are not ASCII replaced."""
    found = dict(signs)
    for sign, letters in _PLAIN.items():
        found = {k: text.replace(sign, letters) for k, text in found.items()}
    return found


ASCII = in_ascii(UNICODE)
LATEX = {
    "complementarity": r"0 \le {g} \perp {lam} \ge 0",
    "impact": r"{rate}^{{+}} = -{e} \, {rate}^{{-}}",
    "poisson": r"\Lambda_e \ge {e} \, \Lambda_c, \; {rate}^{{+}} \ge 0 "
    r"\text{{, where }} \Lambda_c \text{{ ends the approach}}",
    "inelastic": r"{rate}^{{+}} = 0",
    "friction": r"|f| \le {bound} \text{{, against the slip}}",
    "sticking": r"|f| \le {most} \text{{ while it sticks; }} |f| = {bound} "
    r"\text{{ against the slip}}",
    "limit": r"|{lam}| \le {static_limit} \text{{ while it holds; }} |{lam}| = {limit} "
    r"\text{{ against the slip}}",
    "when": r"{lam} = 0 \text{{ unless }} {when}",
}
# The key of a statement in the document, if it differs.
_KEYS = {"inelastic": "impact", "poisson": "impact", "sticking": "friction"}
# Texts of the Python module for parts that it does not write out.
_WORDS = {
    "g": "g", "rate": "g'", "lam": "lambda", "bound": "mu lambda",
    "most": "mu_s lambda", "e": "e", "limit": "F", "static_limit": "F_s",
    "when": "its condition holds",
}  # fmt: skip
_LAW = ("restitution", "friction", "static_friction", "limit", "when")
# The restitution law, where it is not Newton's.
RESTITUTION_LAW = {"restitution_law": "poisson"}


def always(k: Mapping[str, Any]) -> bool:
    """Whether a constraint is an equality that always holds.

    k : the entry of the constraint in the document of a derivation.
    """
    return all(k[key] is None for key in _LAW)


def on_velocities(k: Mapping[str, Any]) -> bool:
    """Whether a constraint is a relation of velocities, not of positions.

    k : the entry of the constraint in the document, where function and rate are then
        one.
    """
    return k["rate"] is k["function"]


def conditions(
    k: Mapping[str, Any],
    write: Printer,
    multiplier: Any,
    called: tuple[str, str],
    signs: Mapping[str, str],
) -> dict[str, str]:
    """Return the conditions on a constraint as texts: key -> statement.

    These are the conditions of a contact, of friction, of a limit and of `when`.

    Parameters
    ----------
    k : mapping
        The entry of the constraint in the document of a derivation.
    write : Printer
        Prints expressions.
    multiplier : sympy expression
        Symbol of the multiplier.
    called : (str, str)
        Names of the gap and its rate.
    signs : mapping of str to str
        Signs of the style, such as `ASCII`.
    """
    parts = {
        "lam": multiplier, "limit": k["limit"], "when": k["when"],
        "static_limit": k["static_limit"],
    }  # fmt: skip
    for word, key in (("bound", "friction"), ("most", "static_friction")):
        parts[word] = None if k[key] is None else k[key] * multiplier
    words = {word: write(e) for word, e in parts.items() if e is not None}
    if "limit" in words:
        words.setdefault("static_limit", words["limit"])
    if "pair" in k:
        words["lam"] = f"({', '.join(write(e) for e in k['pair'])})"
    if not isinstance(k["restitution"], float | None):
        words["e"] = f"({write(k['restitution'])})"
    return _written(k, {"g": called[0], "rate": called[1], **words}, signs)


def in_words(constraint: Constraint) -> tuple[str, ...]:
    """Return the conditions on a constraint as texts, with letters for expressions.

    The expressions of these letters are printed separately.
    """
    given = {**law_of(constraint), "limit": constraint.limit, "when": constraint.when}
    words = _WORDS
    if constraint.static is None:
        words = _WORDS | {"static_limit": _WORDS["limit"]}
    names = ", ".join(f"lambda.{k}" for k in constraint.ends)
    both = {"lam": f"({names})"} if constraint.pair else {}
    return tuple(_written(given, words | both, ASCII).values())


def law_of(constraint: Constraint) -> dict[str, Any]:
    """Return restitution and friction of a constraint, as entries of the document.

    Coefficients of friction are nodes; an entry is None where the constraint has none.
    """
    law = constraint.law
    if law is None:
        return dict.fromkeys(_LAW[:3])
    e = law.restitution if law.bounce is None else law.bounce
    found = dict(zip(_LAW, (e, law.friction, law.static), strict=False))
    return found | (RESTITUTION_LAW if law.poisson else {})


def _written(
    law: Mapping[str, Any], words: Mapping[str, str], signs: Mapping[str, str]
) -> dict[str, str]:
    e = law["restitution"]
    if isinstance(e, float | None):
        words = {**words, "e": f"{e or 0.0:g}"}
    stated = []
    if e is not None:
        law_of_it = law.get("restitution_law", "impact")
        stated += ["complementarity", law_of_it if e != 0.0 else "inelastic"]
    if law["friction"] is not None:
        stated.append("friction" if law["static_friction"] is None else "sticking")
    stated += [key for key in ("limit", "when") if law[key] is not None]
    return {_KEYS.get(s, s): signs[s].format(**words) for s in stated}
