"""When to start and stop, how finely, and how to integrate."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from lagsim.methods import options
from lagsim.model.model import DEFAULT_ROWS, Settings
from lagsim.model.nodes import Scalar, argument
from lagsim.model.reader import quantities
from lagsim.model.reader.fields import Fields, kind_of
from lagsim.tolerances import SAME_STEP, SHORTEST_RUN

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.errors import Place
    from lagsim.model.reader.expressions import Expressions

MAX_ROWS = 10**8


def read_settings(
    section: Fields, options: Mapping[str, str], x: Expressions
) -> Settings:
    """Give the section `simulation`, with what replaces its keys."""
    given = dict(section.found)
    if "duration" in options:
        given.pop("end", None)
    for key, text in options.items():
        value = argument(f"--{key.replace('_', '-')} ", text)
        given[key] = value, value
    return _Reader(Fields(given, section.place, section.sound, x.faults), x).read()


class _Reader:
    def __init__(self, given: Fields, x: Expressions) -> None:
        self.given, self.x = given, x

    def read(self) -> Settings:
        given = self.given
        start = self._number("start") if "start" in given else 0.0
        end = self._end(start)
        output_step = self._positive("output_step")
        method = self._name("method", "see `lagsim methods`")
        formulation = self._name("formulation", "see docs/model-file.md")
        rtol, atol = (self._within(key, 0.0, math.inf) for key in ("rtol", "atol"))
        if rtol == 0 and "atol" not in given:
            hint = "`atol` is rtol times a scale where it is not given"
            self._fault("out-of-range", "`rtol` is 0 without an `atol`", "rtol", hint)
        elif rtol == 0 and atol == 0:
            self._fault("out-of-range", "`rtol` and `atol` are both 0", "atol")
        step, gain = self._positive("step"), self._positive("gain")
        own = ((k, self._within(k, o.least, o.most)) for k, (_, o) in options().items())
        asked = Settings(
            method=method, formulation=formulation, rtol=rtol, atol=atol, step=step,
            gain=gain, options=tuple((k, v) for k, v in own if v is not None),
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
        self.x.faults.add(code, text, self._place(key) or self.given.place, hint)

    def _number(self, key: str) -> float | None:
        node = self.given.value(key)
        if node is None:
            return None
        if key in ("duration", "end") and (hint := quantities.span(node)):
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

    def _within(self, key: str, least: float, most: float) -> float | None:
        value = self._number(key)
        if value is None or least <= value <= most:
            return value
        rule = f"exceed {most:g}"
        if value < least:
            rule = f"be below {least:g}" if least else "be negative"
        self._fault("out-of-range", f"`{key}` is {value:g}; it must not {rule}", key)
        return None

    def _end(self, start: float | None) -> float | None:
        key = "duration" if "duration" in self.given else "end"
        if key == "duration" and "end" in self.given:
            text, place = (
                "both `duration` and `end` are given",
                self.given.place_of("end"),
            )
            self.x.faults.add("both-given", text, place, "give one of them")
        end = self._positive(key) if key == "duration" else self._number(key)
        if end is None or start is None:
            return None
        end += start if key == "duration" else 0.0
        length, text = end - start, ""
        if not (start < end < math.inf and math.isfinite(length)):
            text = f"the run from {start:g} to {end:g} has no positive, finite length"
        elif length < SHORTEST_RUN:
            text = f"the run is {length:g} long; at least {SHORTEST_RUN:g} is expected"
        if text:
            self._fault("out-of-range", text, key)
        return None if text else end

    def _name(self, key: str, hint: str) -> str:
        name = self.given.text(key)
        if not name and isinstance(self.given.value(key), Scalar):
            self._fault("empty", f"`{key}` must be a name, found nothing", key, hint)
        return name or "auto"

    def _check_rows(self, length: float, output_step: float) -> None:
        count = length / output_step
        if count < 1 - SAME_STEP:
            text = f"`output_step` is {output_step:g}, longer than the run, {length:g}"
            self._fault("out-of-range", text, "output_step")
        elif count == math.inf or math.ceil(count - SAME_STEP) + 1 > MAX_ROWS:
            rows = "infinitely many"
            if count < math.inf:
                whole = math.ceil(count - SAME_STEP) + 1
                rows = str(whole) if whole < 10**15 else f"{count:.3g}"
            text = f"`output_step` {output_step:g} makes {rows} rows, more than 10^8"
            hint = f"{length / DEFAULT_ROWS:g} makes {DEFAULT_ROWS + 1}"
            self._fault("too-many-rows", text, "output_step", hint)
