"""Linked parts whose kernels are compiled quickly, and optimised in longer runs.

Most runs are short: the first run on a machine would compile for seconds what runs for
milliseconds. Kernels that the cache does not have optimised are linked as quick code.
Once they have run for `SHORT` they are optimised, and their code is in the cache from
then on. The process that has compiled the quick code optimises its largest part alone,
unless the run is a long one. Both codes have equal bits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.native.link.cache import ProgramPart

# Processor time in quick code, of one process, from which on kernels are optimised. A
# model that needs less is never optimised, and loses at most half of this time a run;
# the next run of one that needs more has optimised code.
SHORT = 0.02
# Further time in quick code for which a first run optimises all parts. The largest, the
# laws of rows or the step of the method, takes most of the time; the others take 1 to
# 2 s to optimise, and save a third of their time.
LONG = 2.5
# The length of all integrations of a run, the second of which, for the error, has steps
# half as long.
INTEGRATIONS = 3.0


class GradualParts:
    """Parts of a program, and which of them are linked as quick code.

    Parameters
    ----------
    parts : sequence of ProgramPart
    quick : bool
        Whether kernels may be linked as quick code.

    Attributes
    ----------
    improvable : list of ProgramPart
        The parts that are linked as quick code.
    """

    def __init__(self, parts: Sequence[ProgramPart], *, quick: bool) -> None:
        self._parts, self._seconds, self._share = parts, 0.0, 0.0
        self.improvable = [
            part for part in parts if quick and part.optimise and not part.is_compiled
        ]

    @property
    def objects(self) -> list[bytes]:
        """Object code of all parts, for an engine."""
        return [
            part.quick_object if part in self.improvable else part.object
            for part in self._parts
        ]

    def used(self, seconds: float, share: float) -> bool:
        """Return whether parts are to be optimised after more time in quick code.

        All parts must then be linked anew; some are compiled before.

        seconds : further processor time in quick code.
        share : the part of the duration that was integrated meanwhile, from 0 to 1.
        """
        self._seconds += seconds
        self._share += share
        if self._seconds < SHORT or not self.improvable:
            return False
        waiting = [part for part in self.improvable if part.is_new]
        rest = self._seconds * (INTEGRATIONS - self._share)
        if not any(x.is_new for x in self._parts if x not in self.improvable):
            largest = max(self.improvable, key=lambda part: len(part.quick_object))
            waiting = [part for part in waiting if part is not largest]
        elif rest >= LONG * self._share:
            waiting = []
        if len(waiting) == len(self.improvable):
            return False
        self.improvable = waiting
        self._seconds = self._share = 0.0
        return True
