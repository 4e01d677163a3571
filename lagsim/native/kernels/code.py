"""Kernels: a small typed subset of Python as LLVM IR, and the same text in CPython.

A kernel is a plain function of annotated parameters (int, float, bool, `Floats`, or a
`Memory`) and result (the same, or None; not an array). It may hold

- numbers and conditions: `+ - * / **`, `// %` of integers, comparisons, `and or not`,
  `a if c else b`, `min max abs int float`, sqrt, floor, pow, sin, ... of `math`;
- memory: `s.t`, `s.t = x`, `s.y` of a parameter annotated with a `layout.Memory`;
- arrays: `a[i]`, `at(a, k)` for `a[k:]`, tuples of targets (`a, b = b, a`);
- `if while for break continue return pass`, `for i in range(...)`, or `apart(n)` where
  no pass touches another's elements: they are then made several at once;
- calls of other kernels and of functions marked `external`;
- static values (see `kernel_source`): `if` on them is decided at translation, the other
  branch is not even read; `for j in unrolled(...)` and `total(... for j in
  unrolled(...))` are written out, and terms with a factor of zero vanish.

A variable has the kind of its first assignment: an int stored into a float variable is
converted, the reverse is an error.

Native code gives the bits of CPython, with these differences where CPython raises or
has more room: division by zero, sqrt(-1.0), exp(1e3) give inf or nan; an integer
divided by zero is divided by one; int(nan) is 0, int(1e300) the largest integer;
integers wrap at 64 bits; indices are not checked, and negative ones do not count from
the end. `x**2` calls pow as CPython does: `x*x` is faster and rounds better.
"""

from __future__ import annotations

import types
from types import FunctionType
from typing import TYPE_CHECKING, Any

from lagsim.native.kernels import words
from lagsim.native.kernels.keys import KernelError, as_kernel, is_own, names_in
from lagsim.native.kernels.lines import PASSED, RETURNED
from lagsim.native.kernels.source import Source
from lagsim.native.kernels.statements import Statements

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

__all__ = ["KernelError", "bind", "translate"]


def translate(
    functions: Sequence[Callable[..., Any]],
    statics: Mapping[str, object] | None = None,
) -> str:
    """Translate kernels, and those they call, to LLVM IR.

    Parameters
    ----------
    functions : sequence of functions
        They become symbols under their names; kernels they call stay internal.
        An external of the name of one of them is that one.
    statics : mapping, optional
        Values that stand before the globals of the same name, in every module.

    Returns
    -------
    str
        The text: the same for the same functions and statics.

    Raises
    ------
    KernelError
        If a kernel leaves the subset.
    """
    return _Translation(functions, statics or {}).text()


def bind(
    function: Callable[..., Any],
    externals: Mapping[str, Callable[..., Any]],
    statics: Mapping[str, object] | None = None,
) -> Callable[..., Any]:
    """Give a kernel as plain Python, with its externals and statics put in.

    Parameters
    ----------
    function : function
        A kernel.
    externals : mapping
        By name, what stands for the functions marked `external`. One that is not given
        raises when called.
    statics : mapping, optional
        As for `translate`.

    Returns
    -------
    function
        A copy: the same code, so that debugger and coverage see the kernel's text.
    """
    copies: dict[FunctionType, FunctionType] = {}

    def copy(original: FunctionType) -> FunctionType:
        if original in copies:
            return copies[original]
        names = dict(original.__globals__)
        copied = copies[original] = types.FunctionType(
            original.__code__, names, original.__name__, None, original.__closure__
        )
        for name in names_in(original.__code__):
            value = names.get(name)
            if not is_own(value):
                continue
            if words.is_external(value):
                names[name] = externals.get(value.__name__, value)
            else:
                names[name] = copy(value)
        names.update(statics or {})
        return copied

    return copy(as_kernel(function))


class _Translation:
    """The functions found so far, and the text they need besides their own."""

    def __init__(
        self,
        functions: Sequence[Callable[..., Any]],
        statics: Mapping[str, object],
    ) -> None:
        self.statics = statics
        self.known: dict[FunctionType, tuple[str, Source]] = {}
        self.symbols: set[str] = set()
        self.waiting: list[tuple[str, Source]] = []
        self.declared: dict[str, None] = {}
        self.loops = 0
        self.exported: frozenset[str] = frozenset()
        for function in functions:
            self._add(as_kernel(function), internal=False)
        self.exported = frozenset(self.symbols)

    def text(self) -> str:
        """Translate what waits, and what comes to wait by it."""
        defined = []
        used: set[str] = set()
        while self.waiting:
            symbol, source = self.waiting.pop(0)
            linkage = "" if symbol in self.exported else "internal "
            made = Statements(source, self)
            defined.append(made.definition(symbol, linkage))
            used |= source.function.__globals__.keys()
        if unknown := self.statics.keys() - used:
            raise KernelError(
                f"statics {', '.join(sorted(unknown))}: no global of that name in the "
                "modules of the kernels"
            )
        return "\n".join([*self.declared, *defined])

    def callee(self, function: FunctionType) -> tuple[str, Source]:
        """Give symbol and signature; see that the function will be there."""
        if function not in self.known:
            self._add(function, internal=True)
        return self.known[function]

    def declare(self, line: str) -> None:
        """Have a declaration or a definition in the text, once."""
        self.declared[line] = None

    def parallel(self) -> int:
        """Give the number of a new mark of a loop whose accesses are apart."""
        self.declare("!0 = distinct !{}")
        self.loops += 1
        properties = '!{!"llvm.loop.parallel_accesses", !0}, '
        properties += '!{!"llvm.loop.vectorize.enable", i1 true}'
        self.declare(f"!{self.loops} = distinct !{{!{self.loops}, {properties}}}")
        return self.loops

    def _defined(self, external: Source) -> tuple[str, Source]:
        """Find the translated function that an external of its name stands for."""
        [found] = (
            (symbol, source)
            for symbol, source in self.known.values()
            if symbol == external.name
        )
        signature = [kind for _, kind in external.parameters], external.result
        if signature != ([kind for _, kind in found[1].parameters], found[1].result):
            raise external.error(
                external.node, "the function of this name has other kinds"
            )
        return found

    def _add(self, function: FunctionType, *, internal: bool) -> None:
        source = Source(function, self.statics)
        symbol = source.name
        if symbol in self.symbols:
            if source.external and symbol in self.exported:
                self.known[function] = self._defined(source)
                return
            if not internal or source.external:
                raise source.error(
                    source.node, f"`{symbol}` is the symbol of another function already"
                )
            symbol = f"{symbol}.{len(self.symbols)}"
        self.symbols.add(symbol)
        self.known[function] = symbol, source
        if source.external:
            kinds = ", ".join(PASSED[kind] for _, kind in source.parameters)
            result = RETURNED[source.result]
            self.declare(f"declare {result} @{symbol}({kinds}) nounwind")
        else:
            self.waiting.append((symbol, source))
