"""When to start and stop, how finely, and how to integrate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lagsim.model.model import Relation, Simulation
from lagsim.model.nodes import Scalar, argument
from lagsim.model.reader.fields import Fields, fields
from lagsim.model.reader.relations import read_relation

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.errors import Place
    from lagsim.model.reader.expressions import Expressions
    from lagsim.model.reader.fields import Entry

KEYS = (
    "start", "duration", "end", "until", "output_step", "method", "rtol", "atol",
    "step", "formulation", "gain", "spectral_radius",
)  # fmt: skip

MAX_ROWS = 10**8
DEFAULT_ROWS = 1000
# The last output step may be this much shorter or longer than the others.
ROW_TOLERANCE = 1e-9


def read_simulation(
    entry: Entry | None, options: Mapping[str, str], x: Expressions, root: Place
) -> Simulation | None:
    """Give the section `simulation`, with what the command line says instead.

    Parameters
    ----------
    entry
        The section.
    options
        Keys of the section, and the expressions that stand for the file's.
    x
        The expressions of the file.
    root
        Where faults are reported if there is no section.
    """
    found = Fields({}, root, sound=True)
    if entry is not None:
        found = fields(entry[1], "`simulation`", KEYS, x.faults, entry[0].place)
    return _Reader(_replaced(found, options), x).read()


def _replaced(found: Fields, options: Mapping[str, str]) -> Fields:
    given = dict(found.found)
    if "duration" in options:
        given.pop("end", None)
    for key, text in options.items():
        value = argument(f"--{key.replace('_', '-')} ", text)
        given[key] = value, value
    return Fields(given, found.place, found.sound)


@dataclass(frozen=True, slots=True)
class _Reader:
    given: Fields
    x: Expressions

    def read(self) -> Simulation | None:
        start = self._number("start") if "start" in self.given else 0.0
        end = self._end(start)
        output_step = self._positive("output_step")
        until = self._until()
        method = self._name("method", "see `lagsim methods`")
        formulation = self._name("formulation", "see docs/model-file.md")
        rtol, atol = self._not_negative("rtol"), self._not_negative("atol")
        self._check_tolerances(rtol, atol)
        step = self._positive("step")
        gain = self._positive("gain")
        spectral_radius = self._not_negative("spectral_radius")
        if spectral_radius is not None and spectral_radius > 1:
            text = f"`spectral_radius` is {spectral_radius:g}; it must not exceed 1"
            self._fault("out-of-range", text, "spectral_radius")
        if start is None or end is None:
            return None
        if output_step is None:
            output_step = (end - start) / DEFAULT_ROWS
        self._check_rows(end - start, output_step)
        return Simulation(
            start, end, output_step, until, method, rtol, atol, step,
            self._place("method"), formulation, gain, spectral_radius,
            self._place("formulation"),
        )  # fmt: skip

    def _place(self, key: str) -> Place | None:
        node = self.given.value(key)
        return node.place if node else None

    def _fault(self, code: str, text: str, key: str, hint: str = "") -> None:
        node = self.given.value(key)
        place = node.place if node else self.given.place
        self.x.faults.add(code, text, place, hint)

    def _number(self, key: str) -> float | None:
        node = self.given.value(key)
        return None if node is None else self.x.number(node, f"`{key}`")

    def _positive(self, key: str) -> float | None:
        value = self._number(key)
        if value is None or value > 0:
            return value
        self._fault("out-of-range", f"`{key}` is {value:g}; it must be positive", key)
        return None

    def _not_negative(self, key: str) -> float | None:
        value = self._number(key)
        if value is None or value >= 0:
            return value
        text = f"`{key}` is {value:g}; it must not be negative"
        self._fault("out-of-range", text, key)
        return None

    def _end(self, start: float | None) -> float | None:
        if "duration" in self.given and "end" in self.given:
            text = "both `duration` and `end` are given"
            place = self.given.place_of("end")
            self.x.faults.add("both-given", text, place, "give one of them")
        if "duration" in self.given:
            duration = self._positive("duration")
            if duration is None or start is None:
                return None
            end, key = start + duration, "duration"
        else:
            given = self._number("end")
            if given is None or start is None:
                return None
            end, key = given, "end"
        if not (start < end < math.inf and math.isfinite(end - start)):
            text = f"the run from {start:g} to {end:g} has no positive, finite length"
            self._fault("out-of-range", text, key)
            return None
        return end

    def _until(self) -> Relation | None:
        node = self.given.value("until")
        return None if node is None else read_relation(node, "`until`", self.x)[0]

    def _name(self, key: str, hint: str) -> str:
        node = self.given.value(key)
        if node is None:
            return "auto"
        name = self.given.text(key, self.x.faults)
        if not name and isinstance(node, Scalar):
            self._fault("empty", f"`{key}` must be a name, found nothing", key, hint)
        return name or "auto"

    def _check_tolerances(self, rtol: float | None, atol: float | None) -> None:
        if rtol == 0 and atol is None and "atol" not in self.given:
            hint = "`atol` is rtol times a scale where it is not given"
            self._fault("out-of-range", "`rtol` is 0 without an `atol`", "rtol", hint)
        elif rtol == 0 and atol == 0:
            self._fault("out-of-range", "`rtol` and `atol` are both 0", "atol")

    def _check_rows(self, length: float, output_step: float) -> None:
        count = length / output_step
        if count < 1 - ROW_TOLERANCE:
            text = f"`output_step` is {output_step:g}, longer than the run, {length:g}"
            self._fault("out-of-range", text, "output_step")
        elif count == math.inf or math.ceil(count - ROW_TOLERANCE) + 1 > MAX_ROWS:
            rows = "infinitely many"
            if count < math.inf:
                whole = math.ceil(count - ROW_TOLERANCE) + 1
                rows = str(whole) if whole < 10**15 else f"{count:.3g}"
            text = f"`output_step` {output_step:g} makes {rows} rows, more than 10^8"
            hint = f"{length / DEFAULT_ROWS:g} makes {DEFAULT_ROWS + 1}"
            self._fault("too-many-rows", text, "output_step", hint)
