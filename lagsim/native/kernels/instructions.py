"""Instructions of LLVM IR for one function: values, variables, blocks and jumps."""

from __future__ import annotations

from typing import Final, NamedTuple

LLVM: Final = {
    "int": "i64",
    "float": "double",
    "bool": "i1",
    "Floats": "ptr",
    "None": "void",
}
PASSED: Final = LLVM | {"bool": "i1 zeroext"}
RETURNED: Final = LLVM | {"bool": "zeroext i1"}


class Value(NamedTuple):
    """A value of the IR: its text, and its kind, a key of LLVM's types."""

    text: str
    kind: str


class Instructions:
    """Instructions of a function, in the order in which they are written.

    Attributes
    ----------
    lines, allocated : list of str
        The instructions so far; allocations of variables, for the entry block.
    live : bool
        Whether the current position is reachable.
    reached : set of str
        Labels that are targets of a jump.
    """

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.allocated: list[str] = []
        self.live = True
        self.reached: set[str] = set()
        self._names = 0

    def _name(self, stem: str) -> str:
        self._names += 1
        return f"%{stem}.{self._names}"

    def _op(self, kind: str, text: str) -> Value:
        """Append an instruction; return its result.

        kind : the kind of the result.
        text : the instruction, without the name of its result.
        """
        name = self._name("x")
        self.lines.append(f"  {name} = {text}")
        return Value(name, kind)

    def _allocate(self, stem: str, kind: str) -> str:
        """Allocate a variable on the stack; return the name of its address in the IR.

        stem : beginning of the name.
        kind : kind of the variable.
        """
        place = self._name(stem)
        self.allocated.append(f"  {place} = alloca {LLVM[kind]}")
        return place

    def _emit_store(self, value: Value, place: str) -> None:
        self.lines.append(f"  store {LLVM[value.kind]} {value.text}, ptr {place}")

    def _get(self, kind: str, place: str) -> Value:
        return self._op(kind, f"load {LLVM[kind]}, ptr {place}")

    def _address(self, array: str, index: object) -> str:
        text = f"getelementptr inbounds double, ptr {array}, i64 {index}"
        return self._op("Floats", text).text

    def _jump(self, label: str) -> None:
        """End a block with a jump to `label`, if the current position is reachable."""
        if self.live:
            self.lines.append(f"  br label {label}")
            self.reached.add(label)
        self.live = False

    def _branch(self, test: Value, yes: str, no: str) -> None:
        """End a block with a jump to label `yes` if `test` is true, else to `no`."""
        self.lines.append(f"  br i1 {test.text}, label {yes}, label {no}")
        self.reached |= {yes, no}

    def _begin(self, label: str) -> None:
        """Begin the block `label`; write no line if no jump has it as its target."""
        self.live = label in self.reached
        if self.live:
            self.lines.append(f"{label[1:]}:")
