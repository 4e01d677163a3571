"""What dependent rows are combinations of, and whether they contradict each other."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.lengths import of_rows

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.admissibility.point import Point
    from lagsim.language.arrays import Floats

# What dependent rows ask for may differ by this part of its size: rounding, and starts
# that were typed.
CONTRADICTION = 1e-8
# Bounds of rounding errors are to first order; this keeps them bounds.
CAUTION = 100.0
LEVELS = ("position", "velocity", "acceleration")


class Dependence(NamedTuple):
    """A row that others span: row = sum of coefficient times row.

    Attributes
    ----------
    combination : tuple of (name, coefficient)
        Empty where the row itself vanishes.
    everywhere : bool or None
        Whether it is so at generic admissible states nearby, or only here; None where
        no such state was found.
    contradictions : dict
        Level -> by how much what the row asks for differs from what the others imply.
    """

    name: str
    combination: tuple[tuple[str, float], ...]
    everywhere: bool | None
    contradictions: dict[str, float]

    def __str__(self) -> str:
        return f"{self.name} = {self.right_side()}"

    def right_side(self) -> str:
        """Give the combination as text, `2 c1 - c2`."""
        text = ""
        for name, c in self.combination:
            sign = " - " if c < 0 else " + "
            size = "" if abs(abs(c) - 1) < 1e-9 else f"{abs(c):.6g} "
            text += f"{sign}{size}{name}"
        if text.startswith(" - "):
            return "-" + text.removeprefix(" - ")
        return text.removeprefix(" + ") or "0"

    def contradiction(self) -> str:
        """Name what contradicts what, on the first level that does; empty if none."""
        for level, size in self.contradictions.items():
            if not self.combination:
                return (
                    f"`{self.name}` cannot be satisfied on the level of {level}: "
                    f"its gradient vanishes, and it is off by {size:.6g}"
                )
            others = " and ".join(f"`{name}`" for name, _ in self.combination)
            return (
                f"`{self.name}` contradicts {others} on the level of {level}, "
                f"by {size:.6g}"
            )
        return ""


class Demands:
    """What each row asks for on each level, with scales and rounding errors."""

    def __init__(
        self,
        point: Point,
        q: Floats,
        v: Floats,
        errors: Mapping[str, float],
        levels: Sequence[str],
    ) -> None:
        rows = point.e.rows
        nodes = {
            "position": [r.residual if r.holonomic else point.g.zero for r in rows],
            "velocity": [r.rate for r in rows],
            "acceleration": [r.b for r in rows],
        }
        sizes = {
            "position": [r.residual_scale for r in rows],
            "velocity": [r.rate_scale for r in rows],
            "acceleration": nodes["acceleration"],
        }
        self.levels = levels
        self.values = {k: point.array(nodes[k], q, v) for k in levels}
        self.errors = {k: point.rounding(nodes[k], q, v, errors) for k in levels}
        self.scales = {k: abs(point.array(sizes[k], q, v)) for k in levels}
        # Not with terms that only the distance from the origin makes large.
        lengths = of_rows(point, rows, q, v)
        for level, own in (("position", lengths.scales), ("velocity", lengths.motions)):
            if level in levels:
                self.scales[level] = np.fmin(self.scales[level], own())

    def contradictions(self, i: int, others: dict[int, float]) -> dict[str, float]:
        """Give the levels on which row i differs from the combination of others."""
        found = {}
        for level in self.levels:
            # That a vanishing row is not met is no contradiction yet: states elsewhere
            # may meet it.
            if level == "position" and not others:
                continue
            values, errors = self.values[level], self.errors[level]
            scales = self.scales[level]
            gap, scale, error = values[i], scales[i], errors[i]
            for j, c in others.items():
                gap = gap - c * values[j]
                scale, error = scale + abs(c) * scales[j], error + abs(c) * errors[j]
            if abs(gap) > CONTRADICTION * scale + CAUTION * error:
                found[level] = float(abs(gap))
        return found
