"""Expressions that a comma has split, between the braces and brackets of YAML."""

from __future__ import annotations

from lagsim.errors import Problem
from lagsim.model.nodes.tree import Broken, Node, Scalar, Source

# A call has no more arguments than this, so a longer search is in vain (and slow).
_MOST_PIECES = 20


def joined_pieces(
    source: Source, parts: list[Node], *, mapping: bool
) -> tuple[list[Node], list[Problem]]:
    """Find expressions that a comma has split, and put `Broken` in their place.

    In `{relation: atan2(y, x) = 0}` YAML sees the keys `relation` and `x) = 0`.

    Parameters
    ----------
    source
        The text.
    parts
        The items of a sequence in brackets, or keys and values in turn.
    mapping
        Which of the two.
    """
    whole: list[Node] = []
    problems: list[Problem] = []
    step = 2 if mapping else 1
    i = 0
    while i < len(parts):
        whole += parts[i : i + step]
        last = _end_of_split(parts, i + step - 1, step)
        if last is not None:
            problem, whole[-1] = _split(source, whole[-1], parts[last])
            problems.append(problem)
            i = last
        i += step
    return whole, problems


def _split(source: Source, first: Node, last: Node) -> tuple[Problem, Broken]:
    assert isinstance(first, Scalar)
    assert isinstance(last, Scalar)
    start, stop = first.span.start, last.span.end
    place = source.place(start, stop - start)
    text = " ".join(source.text[start:stop].split())
    problem = Problem(
        "split-by-comma",
        "the comma inside the parentheses ends the value here",
        place,
        f'quote the expression: "{text}"',
    )
    return problem, Broken(place)


def _end_of_split(parts: list[Node], i: int, step: int) -> int | None:
    """Give the index of the piece that closes the parenthesis left open by part i."""
    depth = _left_open(parts[i])
    if depth <= 0:
        return None
    for j in range(i + 1, min(len(parts), i + 1 + step * _MOST_PIECES), step):
        piece, value = parts[j], parts[j + step - 1]
        if not isinstance(piece, Scalar) or piece.quoted:
            return None
        if step == 2 and not (isinstance(value, Scalar) and value.empty):
            return None
        depth += _left_open(piece)
        if depth <= 0:
            return j
    return None


def _left_open(part: Node) -> int:
    if not isinstance(part, Scalar) or part.quoted:
        return 0
    return part.text.count("(") - part.text.count(")")
