"""What the law of a constraint asks of its gap, rate and multiplier, in words of signs.

The same statements in every style; a style says how gap and rate are called there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from lagsim.model.model import Constraint
    from lagsim.show.content import Condition
    from lagsim.show.writer import Writer


UNICODE = {
    "complementarity": "0 ≤ {g} ⊥ {lam} ≥ 0",
    "impact": "{rate}⁺ = −{e} {rate}⁻",
    "inelastic": "{rate}⁺ = 0",
    "friction": "|f| ≤ {bound}, against the slip",
    "sticking": "|f| ≤ {most} while it sticks; |f| = {bound} against the slip",
    "limit": "|{lam}| ≤ {limit} while it holds; |{lam}| = {limit} against the slip",
    "when": "{lam} = 0 unless {when}",
}
_PLAIN = {"≤": "<=", "≥": ">=", "⊥": "_|_", "⁺": "+", "⁻": "-", "−": "-"}
ASCII = {k: "".join(_PLAIN.get(c, c) for c in text) for k, text in UNICODE.items()}
LATEX = {
    "complementarity": r"0 \le {g} \perp {lam} \ge 0",
    "impact": r"{rate}^{{+}} = -{e} \, {rate}^{{-}}",
    "inelastic": r"{rate}^{{+}} = 0",
    "friction": r"|f| \le {bound} \text{{, against the slip}}",
    "sticking": r"|f| \le {most} \text{{ while it sticks; }} |f| = {bound} "
    r"\text{{ against the slip}}",
    "limit": r"|{lam}| \le {limit} \text{{ while it holds; }} |{lam}| = {limit} "
    r"\text{{ against the slip}}",
    "when": r"{lam} = 0 \text{{ unless }} {when}",
}
# What a statement is about, where that is not its key.
ABOUT = {"inelastic": "impact", "sticking": "friction"}


# How the module in Python calls what it does not write out.
_WORDS = {
    "g": "g", "rate": "g'", "lam": "lambda", "bound": "mu lambda",
    "most": "mu_s lambda", "limit": "F", "when": "its condition holds",
}  # fmt: skip


def conditions(
    k: Condition,
    write: Writer,
    multiplier: Any,
    called: tuple[str, str],
    signs: Mapping[str, str],
) -> dict[str, str]:
    """Give what the law asks: what a statement is about -> the statement.

    Parameters
    ----------
    multiplier
        Its symbol.
    called
        How the gap and its rate are.
    signs
        Those of the style, above.
    """
    law, words = k.law, {"lam": write(multiplier)}
    words["g"], words["rate"] = called
    for word, key in (("bound", "friction"), ("most", "static")):
        if key in law:
            words[word] = write(law[key] * multiplier)
    if "limit" in law:
        words["limit"] = write(law["limit"])
    if "when" in law:
        words["when"] = when(law["when"], write)
    return _told(law, words, signs)


def in_words(constraint: Constraint) -> tuple[str, ...]:
    """Give the same with letters for what has an expression of its own."""
    law = constraint.law
    given: dict[str, Any] = {"limit": constraint.limit, "when": constraint.when}
    if law is not None:
        given |= {"friction": law.friction, "static": law.static}
    given = {key: node for key, node in given.items() if node is not None}
    if law is not None:
        given["restitution"] = law.restitution
    return tuple(_told(given, _WORDS, ASCII).values())


def when(choice: Any, write: Writer) -> str:
    """Give the condition that `if(condition, 1, 0)` asks for."""
    decided = not choice.is_Piecewise
    return write(choice) if decided else write.condition(choice.args[0][1])


def _told(
    law: Mapping[str, Any], words: Mapping[str, str], signs: Mapping[str, str]
) -> dict[str, str]:
    e = f"{law.get('restitution', 0.0):g}"
    found = _statements(law)
    return {ABOUT.get(s, s): signs[s].format(e=e, **words) for s in found}


def _statements(law: Mapping[str, Any]) -> Iterator[str]:
    if "restitution" in law:
        yield "complementarity"
        yield "impact" if law["restitution"] else "inelastic"
    if "friction" in law:
        yield "sticking" if "static" in law else "friction"
    for key in ("limit", "when"):
        if key in law:
            yield key
