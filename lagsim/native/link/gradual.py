"""Linked parts that are compiled quickly, and optimised in longer runs.

Most runs are short: the first run on a machine would compile for seconds what runs for
milliseconds. Kernels and functions of the model that the cache does not have optimised
are linked as quick code. Once they have run for `SHORT` they are optimised, and their
code is in the cache from then on. Both codes have equal bits.

A second process optimises half of the parts where a core is free. New functions of the
model, which take less time, it optimises into the cache while the run goes on; if the
run ends first, the part in hand is given up.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from lagsim.native.link import ahead
from lagsim.native.link.cache import compile_parts, folder

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lagsim.native.link.cache import ProgramPart

# Processor time in quick code, of one process, from which on it is optimised. A
# model that needs less is never optimised, and loses at most half of this time a run;
# the next run of one that needs more has optimised code.
SHORT = 0.02


class GradualParts:
    """Parts of a program, and which of them are linked as quick code.

    Parameters
    ----------
    parts : sequence of ProgramPart
    quick : bool
        Whether parts may be linked as quick code.

    Attributes
    ----------
    improvable : list of ProgramPart
        The parts that are linked as quick code.
    """

    def __init__(self, parts: Sequence[ProgramPart], *, quick: bool) -> None:
        self._parts, self._left = parts, SHORT
        self._new: list[ProgramPart] = []  # compiled in this process
        self._is_optimised: Callable[[], bool] | None = None
        self.improvable = [
            part for part in parts if quick and part.gradual and not part.is_compiled
        ]

    @property
    def objects(self) -> list[bytes]:
        """Object code of all parts, for an engine."""
        self._new += compile_parts(self._parts, self.improvable)
        objects = list[bytes]()
        for part in self._parts:
            quick = part in self.improvable
            objects += part.quick_objects if quick else [part.object]
        return objects

    def used(self, seconds: float) -> bool:
        """Count time in quick code; return whether optimised code is to take over.

        If so, `objects` has more optimised code from now on, and must be linked again.

        seconds : further processor time in quick code.
        """
        self._left -= seconds
        if self._left > 0.0 or not self.improvable:
            return False
        new = [x for x in self.improvable if x in self._new and not x.optimise]
        if len(new) < len(self.improvable):
            return self._optimise(new)
        if self._is_optimised is None and folder() is not None:
            # The shortest first: more of them are optimised before a short run ends.
            parts = sorted(new, key=lambda part: len(part.quick_content))
            tasks = [partial(getattr, part, "content") for part in parts]
            self._is_optimised = ahead.beside(tasks)
        if self._is_optimised is not None and not self._is_optimised():
            self._left = SHORT  # asked again later: an answer costs as much as an event
            return False
        return self._optimise([])

    def _optimise(self, but: list[ProgramPart]) -> bool:
        """Optimise all parts of quick code except `but`, and return True."""
        self.improvable = but
        # The second process that draws pictures waits for the results of the run.
        compile_parts([x for x in self._parts if x not in but], [], alone=True)
        return True
