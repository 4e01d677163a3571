"""Linked parts whose kernels are first compiled quickly, and optimised as they run.

Most runs are short: the first run on a machine would compile for seconds what runs for
milliseconds. Kernels that the cache does not have optimised are linked as quick code.
While they run, one part after the other is optimised, in the order of the program; its
code is in the cache from then on. Both codes have equal bits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.native.link.cache import ProgramPart

# Processor time in quick code before the first part is optimised, and before each
# further part: where this process has compiled quick code, and where an earlier one
# has. A program that is used again pays for the compilation of its parts.
FIRST_USE = (1.0, 0.25)
LATER_USE = (0.02, 0.02)


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
        The parts that are linked as quick code, in the order of the program.
    """

    def __init__(self, parts: Sequence[ProgramPart], *, quick: bool) -> None:
        self._parts = parts
        self.improvable = [
            part for part in parts if quick and part.optimise and not part.is_compiled
        ]
        known = bool(self.improvable) and all(x.was_quick for x in self.improvable)
        self._left, self._each = LATER_USE if known else FIRST_USE

    @property
    def objects(self) -> list[bytes]:
        """Object code of all parts, for an engine."""
        return [
            part.quick_object if part in self.improvable else part.object
            for part in self._parts
        ]

    def used(self, seconds: float) -> bool:
        """Return whether a part is to be optimised after more time in quick code.

        The parts must then be linked anew, and the object of this part is compiled.

        seconds : further processor time in quick code.
        """
        self._left -= seconds
        if self._left > 0.0 or not self.improvable:
            return False
        self._left = self._each
        self.improvable = self.improvable[1:]
        return True
