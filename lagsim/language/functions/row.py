"""What is known of a function: the columns of the table."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.builder import Builder, Coefficients

    Arguments = tuple[int, ...]
    Partials = Callable[[Builder, Arguments, int], Arguments]
    Condition = Callable[[Builder, Arguments], int | None]

# What a function of a library costs, in additions (measured: sin 18, exp 15).
TRANSCENDENTAL = 16
# Convolutions in a step of the chain rule: the slope's and the function's own.
CHAIN = 2.0


class Function(NamedTuple):
    """One row. What is not told is as it is for most.

    Attributes
    ----------
    value
        The function in Python; may raise ValueError or OverflowError, which
        `Function.__call__` turns into nan and inf.
    partials
        `(graph, arguments, itself) -> one node per argument`. None for what is
        differentiated branch by branch (`branches`) or not at all (conditions).
    branches
        For functions that select among their last two arguments: the condition under
        which the first of them is taken, as `(graph, arguments) -> node`.
    condition
        The value is a truth value.
    native
        LLVM IR, one instruction per line, the last one the value. `{0}`, `{1}` are the
        operands, `{a}`, `{b}` fresh names, `{c0}` a condition.
    declares
        External symbols that `native` needs, as LLVM declarations.
    sympy
        `(sympy module, *arguments)`.
    spelled
        For people it stays as written: sympy's would be rewritten, or differentiated
        otherwise.
    python
        The value as Python code with numpy; `{0}`, `{1}` are the arguments.
    text, latex
        The name for people, or what stands before and behind the arguments.
    interval
        The rule for enclosures, made from the module `interval_rules`.
    series, convolutions
        The recurrence of Taylor coefficients `(coefficients, node)`, and how many
        convolutions it takes. None: the chain rule.
    cost
        In additions.
    simpler
        `(graph, *arguments)`: a simpler node of the same value, or None.
    commutes
        Two arguments may be exchanged.
    exact
        The value is not rounded (what selects or steps is not either).
    steep
        A slope is infinite somewhere.
    domain
        The condition under which there is a value; None where there always is one.
    switch, step
        The graph has a corner or a jump; it is flat but for jumps.
    decided_by
        The step that tells on which side of its corner the function is.
    binds, sign
        Of operators: how tightly they bind, and how they are written.
    """

    name: str
    arity: int
    value: Callable[..., Any]
    native: str
    sympy: Callable[..., Any]
    python: str
    interval: Callable[[Any], Callable[..., Any]]
    partials: Partials | None = None
    branches: Callable[[Builder, Arguments], int] | None = None
    condition: bool = False
    spelled: bool = False
    declares: tuple[str, ...] = ()
    text: str | tuple[str, str] = ""
    latex: str | tuple[str, str] = ""
    series: Callable[[Coefficients, int], int] | None = None
    convolutions: float = CHAIN
    cost: int = 1
    simpler: Callable[..., int | None] | None = None
    commutes: bool = False
    exact: bool = False
    steep: bool = False
    domain: Condition | None = None
    switch: bool = False
    step: bool = False
    decided_by: str = ""
    binds: int = 0
    sign: str = ""

    def __call__(self, *arguments: Any) -> Any:
        """Give the value at float `arguments`, as IEEE 754 has it."""
        try:
            return self.value(*arguments)
        except ValueError:
            return math.nan
        except OverflowError:
            return math.inf

    @property
    def rounds(self) -> bool:
        """The value is rounded: it is none of its arguments, and no whole number."""
        return not (self.exact or self.step or self.branches or self.condition)


def libm(name: str, arity: int = 1) -> dict[str, Any]:
    """Give the columns of what C's library computes."""
    kinds = ", ".join(["double"] * arity)
    operands = ", ".join(f"double {{{i}}}" for i in range(arity))
    return {
        "native": f"call double @{name}({operands})",
        "declares": (f"declare double @{name}({kinds}) nounwind memory(none)",),
    }


def intrinsic(name: str, arity: int = 1) -> dict[str, Any]:
    """Give the columns of what LLVM knows itself."""
    kinds = ", ".join(["double"] * arity)
    operands = ", ".join(f"double {{{i}}}" for i in range(arity))
    return {
        "native": f"call double @llvm.{name}.f64({operands})",
        "declares": (f"declare double @llvm.{name}.f64({kinds})",),
    }
