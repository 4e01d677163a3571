"""The modes of an arc and the truth of conditions: their record, selections, trials.

The kernels read the modes of the file, the branches of switches of t, and the modes of
surfaces and laws from the memory of the arc (`methods.parts.parameters.ModeWords`). A
phase of `run.settle` writes the modes that it tries and selects there, in a `Selection`
and nowhere else: the functions of the model are evaluated with these modes. A selection
stays in force, unless an error ends it. A `TrialModes` restores the modes before it.
The truth of the conditions of events, which is in the memory of the method, belongs to
the modes.

Within an arc the kernel itself changes some words:

- the cell of a table of t, at a knot;
- the side of a surface that is passed without a decision;
- a slack: of such a surface, after a value has left it, and where it contains a margin
  for values that leave 0 from rest (`methods.parts.leaving`);
- `law_opens`, the laws that open in a step that an event has cut short;
- the truth of a condition that becomes false, or that waits for another one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.methods.parts import parameters as kept

if TYPE_CHECKING:
    from typing import Self

    from lagsim.run.arc import Arc


# Bytes of a word of the memory.
WORD = 8


class ArcModes(NamedTuple):
    """All modes that are fixed in an arc: of the file, of t, of surfaces and laws.

    Attributes
    ----------
    numbers, arrays : bytes
        Copies of the numbers and of all arrays of `ModeWords`, in their order. The
        modes of the file and the branches of t are the first of the arrays.
    truth : bytes
        The orientations, then the leeways, of all conditions; empty without conditions.
    """

    numbers: bytes
    arrays: bytes
    truth: bytes

    @classmethod
    def of(cls, arc: Arc) -> ArcModes:
        """Return a copy of the modes and the truth in the memory of the arc."""
        numbers, arrays = arc.system.p.modes
        return cls(bytes(numbers), bytes(arrays), bytes(arc.state.truth_words))


def write(arc: Arc, modes: ArcModes) -> None:
    """Write modes and truth to the memory of the arc, which the kernels read.

    If modes of the file or branches of t change, expressions of these alone are
    evaluated again.
    """
    p = arc.system.p
    numbers, arrays = p.modes
    given = WORD * (p.model_modes + p.switches)
    changed = given > 0 and bytes(arrays[:given]) != modes.arrays[:given]
    numbers[:], arrays[:], arc.state.truth_words[:] = modes
    if changed:
        arc.runner.prepare()


class Selection:
    """Context in which a phase selects modes and the truth, in the memory of the arc.

    Within the context the functions of the model are evaluated with the modes selected
    so far. The modes stay in force after it, unless an exception ends the context. If
    modes of the file or branches of t change, the phase calls `Runner.prepare`.

    Attributes
    ----------
    before : ArcModes
        The modes and the truth at the start of the context.
    """

    def __init__(self, arc: Arc) -> None:
        self.arc, self.before = arc, ArcModes.of(arc)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, error: type[BaseException] | None, *_about: object) -> None:
        if error is not None:
            self.undo()

    def undo(self) -> None:
        """Restore the modes and the truth at the start of the context."""
        if ArcModes.of(self.arc) != self.before:
            write(self.arc, self.before)


class TrialModes(Selection):
    """Context in which modes and the truth are tried; its end restores the former."""

    def __exit__(self, *_error: object) -> None:
        self.undo()


class EqualitiesAlone:
    """Context in which no laws act but massless sliders and equalities in force.

    Such an equality is a relation whose condition `when` is true; equalities without a
    condition are no laws. The end of the context restores the modes of the laws.
    """

    def __init__(self, arc: Arc) -> None:
        self.arc, self.mode = arc, arc.system.p.law_mode.copy()

    def __enter__(self) -> None:
        arc, system, p = self.arc, self.arc.system, self.arc.system.p
        if not system.laws:
            return
        off = ~system.law_table.equal
        if system.has_times:
            conditions = arc.runner.function("conditions", len(off))(arc.t, arc.y)
            off |= conditions == 0.0
        p.law_mode[off & (p.law_place < 0.0)] = kept.OFF  # sliders have no mass

    def __exit__(self, *_error: object) -> None:
        self.arc.system.p.law_mode[:] = self.mode
