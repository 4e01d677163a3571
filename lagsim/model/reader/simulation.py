"""When to start and stop, how finely, and how to integrate."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from lagsim.methods import options
from lagsim.model.model import DEFAULT_ROWS, Settings
from lagsim.model.nodes import Scalar, argument
from lagsim.model.reader.equations import read_relation
from lagsim.model.reader.fields import (
    EXPRESSION,
    PLAIN,
    Fields,
    described,
    fields,
    keyed,
    kind_of,
)
from lagsim.model.reader.quantities import span

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.errors import Place
    from lagsim.model.model import Relation
    from lagsim.model.reader.expressions import Expressions
    from lagsim.model.reader.fields import Entry

KEYS = {
    "start": described("When the run begins; default 0.", EXPRESSION),
    "duration": described("How long it lasts, more than 0; or `end`.", EXPRESSION),
    "end": described("When the run ends; or `duration`.", EXPRESSION),
    "until": described(
        "A relation at which the run stops, if before the end.", EXPRESSION
    ),
    "output_step": described("Spacing of the rows; default duration/1000.", EXPRESSION),
    "method": described("The integration method, see `lagsim methods`.", PLAIN),
    "rtol": described("Relative tolerance; default 1e-11.", EXPRESSION),
    "atol": described(
        "Absolute tolerance; default rtol times the component's own scale.", EXPRESSION
    ),
    "step": described("Only for methods of a fixed step.", EXPRESSION),
    "formulation": described(
        "How constraints are satisfied, and what is left out.", PLAIN
    ),
    "gain": described(
        "Only for the formulation baumgarte, per unit of time; default "
        "0.1/output_step.",
        EXPRESSION,
    ),
    **{
        key: described(
            f"Only for the method {name}, {x.least:g} to {x.most:g}: {x.about}.",
            EXPRESSION,
        )
        for key, (name, x) in options().items()
    },
}
FORM = {**keyed(KEYS), "not": {"required": ["duration", "end"]}}

MAX_ROWS = 10**8
# Shorter runs have rows and steps that doubles cannot tell apart.
SHORTEST = 1e-290
# The last output step may be this much shorter or longer than the others.
ROW_TOLERANCE = 1e-9


def simulation_fields(entry: Entry | None, x: Expressions, root: Place) -> Fields:
    """Give the keys of the section; faults where it is missing are those of `root`."""
    if entry is None:
        return Fields({}, root, sound=True)
    return fields(entry[1], "`simulation`", KEYS, x.faults, entry[0].place)


def read_until(section: Fields, x: Expressions) -> Relation | None:
    """Give the relation at which a run ends."""
    node = section.value("until")
    return None if node is None else read_relation(node, "`until`", x)[0]


def read_settings(
    section: Fields, options: Mapping[str, str], x: Expressions
) -> Settings:
    """Give the rest of the section, with what stands for it instead."""
    return _Reader(_replaced(section, options), x).read()


def _replaced(found: Fields, options: Mapping[str, str]) -> Fields:
    given = dict(found.found)
    if "duration" in options:
        given.pop("end", None)
    for key, text in options.items():
        value = argument(f"--{key.replace('_', '-')} ", text)
        given[key] = value, value
    return Fields(given, found.place, found.sound)


class _Reader(NamedTuple):
    given: Fields
    x: Expressions

    def read(self) -> Settings:
        start = self._number("start") if "start" in self.given else 0.0
        end = self._end(start)
        output_step = self._positive("output_step")
        method = self._name("method", "see `lagsim methods`")
        formulation = self._name("formulation", "see docs/model-file.md")
        rtol, atol = self._not_negative("rtol"), self._not_negative("atol")
        self._check_tolerances(rtol, atol)
        step = self._positive("step")
        gain = self._positive("gain")
        own = [(k, value) for k in options() if (value := self._option(k)) is not None]
        asked = Settings(
            method=method, formulation=formulation, rtol=rtol, atol=atol, step=step,
            gain=gain, options=tuple(own),
            method_place=self._place("method"),
            formulation_place=self._place("formulation"),
        )  # fmt: skip
        if start is None or end is None:
            return asked._replace(start=start or 0.0, end=start or 0.0)
        if output_step is None:
            output_step = (end - start) / DEFAULT_ROWS
        self._check_rows(end - start, output_step)
        return asked._replace(start=start, end=end, output_step=output_step)

    def _place(self, key: str) -> Place | None:
        node = self.given.value(key)
        return node.place if node else None

    def _fault(self, code: str, text: str, key: str, hint: str = "") -> None:
        node = self.given.value(key)
        place = node.place if node else self.given.place
        self.x.faults.add(code, text, place, hint)

    def _number(self, key: str) -> float | None:
        node = self.given.value(key)
        if node is None:
            return None
        if key in ("duration", "end") and (hint := span(node)):
            text = f"`{key}` must be one time, found {kind_of(node)}"
            self._fault("not-an-expression", text, key, hint)
            return None
        return self.x.number(node, f"`{key}`")

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

    def _option(self, key: str) -> float | None:
        """Give an option of a method."""
        x = options()[key][1]
        value = self._number(key)
        if value is not None and not x.least <= value <= x.most:
            rule = f"exceed {x.most:g}"
            if value < x.least:
                rule = f"be below {x.least:g}" if x.least else "be negative"
            self._fault(
                "out-of-range", f"`{key}` is {value:g}; it must not {rule}", key
            )
        return value

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
        if end - start < SHORTEST:
            text = f"the run is {end - start:g} long; at least {SHORTEST:g} is expected"
            self._fault("out-of-range", text, key)
            return None
        return end

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
