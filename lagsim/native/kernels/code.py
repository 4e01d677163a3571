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

import ast
import types
from types import FunctionType
from typing import TYPE_CHECKING, Any, NamedTuple

from lagsim.native.kernels import words
from lagsim.native.kernels.expressions import (
    LLVM,
    PASSED,
    RETURNED,
    Calls,
    Value,
    stack_place,
)
from lagsim.native.kernels.keys import KernelError, as_kernel, is_own, names_in
from lagsim.native.kernels.source import Source, unsupported

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lagsim.native.kernels.expressions import Program


class _Loop(NamedTuple):
    """A loop around the present place."""

    after: str
    next: str
    at_break: list[frozenset[str]]
    at_next: list[frozenset[str]]


class Statements(Calls):
    """One function: its statements."""

    def __init__(self, source: Source, program: Program) -> None:
        super().__init__(source, program)
        self.live = True  # whether the present place is reached
        self.loops_around: list[_Loop] = []
        self._statements: dict[type[ast.stmt], Callable[[Any], None]] = {
            ast.Expr: self._expression_statement,
            ast.Assign: self._assign,
            ast.AugAssign: self._augmented,
            ast.If: self._if,
            ast.While: self._while,
            ast.For: self._for,
            ast.Break: self._break,
            ast.Continue: self._continue,
            ast.Return: self._return,
            ast.Pass: lambda _: None,
        }

    def definition(self, symbol: str, linkage: str) -> str:
        """Give the text of the function."""
        source = self.source
        parameters = []
        for name, kind in source.parameters:
            if kind == "None":
                raise source.error(source.node, f"parameter `{name}` is None")
            parameters.append(f'{PASSED[kind]} %"{name}"')
            self._store_name(source.node, name, Value(f'%"{name}"', kind))
        if source.result == "Floats":
            raise source.error(source.node, "a kernel gives no array; pass it one")
        self.block(source.node.body)
        if self.live and source.result != "None":
            raise source.error(source.node, "may end without `return`")
        if self.live:
            self.lines.append("  ret void")
        head = (
            f"define {linkage}{RETURNED[source.result]} @{symbol}"
            f"({', '.join(parameters)}) nounwind {{"
        )
        return "\n".join([head, "entry:", *self.allocated, *self.lines, "}\n"])

    def block(self, body: list[ast.stmt]) -> None:
        """Translate statements, as far as they are reached."""
        for statement in body:
            if not self.live:
                return
            rule = self._statements.get(type(statement))
            if rule is None:
                unsupported(self.source, statement)
            rule(statement)

    def _begin(self, label: str, assigned: frozenset[str] | None = None) -> None:
        """Start a block that is reached, with these variables assigned."""
        self.start(label)
        self.live = True
        if assigned is not None:
            self.assigned = set(assigned)

    def _leave(self, label: str) -> None:
        """Go to `label`, if this place is reached."""
        if self.live:
            self.jump(label)
        self.live = False

    # Assignment.

    def _expression_statement(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call):
            self.expression(node.value)
        elif not isinstance(node.value, ast.Constant):
            raise self.source.error(
                node, f"`{ast.unparse(node)}` does nothing; a call or an assignment"
            )

    def _assign(self, node: ast.Assign) -> None:
        targets = node.targets
        if not any(isinstance(t, ast.Tuple) for t in targets):
            value = self.expression(node.value)
            for target in targets:
                self._store(target, value)
            return
        values = None
        if isinstance(node.value, ast.Tuple):
            values = [self.expression(v) for v in node.value.elts]
        for target in targets:
            if (
                values is None
                or not isinstance(target, ast.Tuple)
                or len(target.elts) != len(values)
            ):
                raise self.source.error(
                    node, "left and right of `=` stand the same number of values"
                )
            for single, value in zip(target.elts, values, strict=True):
                self._store(single, value)

    def _augmented(self, node: ast.AugAssign) -> None:
        # The place is found once and read before the right side is evaluated.
        target = node.target
        if isinstance(target, ast.Subscript) or self.source.field(target):
            place = self._place(target)
            now = self.op("float", f"load double, ptr {place}")
            value = self.arithmetic(node, now, node.op, self.number(node.value))
            self.store(self.cast(value, "float", node, "the value"), place)
            return
        if not isinstance(target, ast.Name):
            unsupported(self.source, node)
        present = ast.copy_location(ast.Name(target.id, ast.Load()), target)
        now = self.number(present)
        value = self.arithmetic(node, now, node.op, self.number(node.value))
        self._store(target, value)

    def _place(self, target: ast.expr) -> str:
        if isinstance(target, ast.Subscript):
            return self.element(target)
        return self.number_place(target)

    def _store(self, target: ast.expr, value: Value) -> None:
        if isinstance(target, ast.Subscript | ast.Attribute):
            place = self._place(target)
            self.store(self.cast(value, "float", target, "the value"), place)
        elif isinstance(target, ast.Name):
            self._store_name(target, target.id, value)
        else:
            raise self.source.error(
                target, f"`{ast.unparse(target)}` takes no value; a name or an element"
            )

    def _store_name(self, node: ast.AST, name: str, value: Value) -> None:
        if name in self.loops:
            raise self.source.error(node, f"`{name}` counts an unrolled loop")
        if value.kind == "None":
            raise self.source.error(node, f"`{name}` is given no value: None")
        if name not in self.kinds:
            self.kinds[name] = value.kind
            self.allocated.append(f"  {stack_place(name)} = alloca {LLVM[value.kind]}")
        kind = self.kinds[name]
        what = f"the value of `{name}`, which began as {kind},"
        self.store(self.cast(value, kind, node, what), stack_place(name))
        self.assigned.add(name)

    # Branches.

    def _if(self, node: ast.If) -> None:
        known = self.fold(node.test)
        if isinstance(known, bool):
            self.block(node.body if known else node.orelse)
            return
        test = self.condition(node.test)
        yes, no, end = map(self.name, ("then", "else", "endif"))
        self.branch(test, yes, no)
        before = frozenset(self.assigned)
        after = []
        for label, body in ((yes, node.body), (no, node.orelse)):
            self._begin(label, before)
            self.block(body)
            if self.live:
                after.append(frozenset(self.assigned))
            self._leave(end)
        if after:
            self._begin(end, frozenset.intersection(*after))

    def _return(self, node: ast.Return) -> None:
        kind = self.source.result
        none = isinstance(node.value, ast.Constant) and node.value.value is None
        if node.value is None or none:
            if kind != "None":
                raise self.source.error(node, f"returns nothing, not {kind}")
            self.lines.append("  ret void")
        else:
            value = self.converted(node.value, kind, "the result")
            self.lines.append(f"  ret {LLVM[kind]} {value.text}")
        self.live = False

    # Loops.

    def _while(self, node: ast.While) -> None:
        self._no_else(node)
        head, body = self.name("while"), self.name("do")
        loop = _Loop(self.name("endwhile"), head, [], [])
        self._leave(head)
        self._begin(head)
        if self.fold(node.test) is not True:
            self.branch(self.condition(node.test), body, loop.after)
            loop.at_break.append(frozenset(self.assigned))
            self._begin(body)
        self._body(node, loop)
        self._leave(head)
        self._after(loop)

    def _for(self, node: ast.For) -> None:
        self._no_else(node)
        if self.unrolled_bounds(node.iter) is not None:
            self._unrolled(node)
            return
        start, stop, step = self._range(node)
        counter = self.allocate("counter", "int")
        self.store(start, counter)
        head, body, advance = map(self.name, ("for", "do", "next"))
        first = len(self.lines)
        loop = _Loop(self.name("endfor"), advance, [], [])
        self._leave(head)
        self._begin(head)
        now = self.op("int", f"load i64, ptr {counter}")
        relation = "slt" if step > 0 else "sgt"
        test = self.op("bool", f"icmp {relation} i64 {now.text}, {stop.text}")
        self.branch(test, body, loop.after)
        loop.at_break.append(frozenset(self.assigned))
        self._begin(body)
        # The variable is a copy: as in Python, storing into it does not move the loop,
        # and afterwards it is the last one the body had.
        self._store(node.target, now)
        self._body(node, loop)
        self._leave(advance)
        self._begin(advance)
        now = self.op("int", f"load i64, ptr {counter}")
        self.store(self.op("int", f"add nsw i64 {now.text}, {step}"), counter)
        self._leave(head)
        if self._goes_over(node, words.apart):
            self._set_apart(first)
        self._after(loop)

    def _set_apart(self, first: int) -> None:
        """Mark a loop, from line `first` to its jump back, as one of `apart`."""
        for k in range(first, len(self.lines)):
            line = self.lines[k]
            if line.startswith("  store ") or " = load " in line:
                self.lines[k] += ", !llvm.access.group !0"
        self.lines[-1] += f", !llvm.loop !{self.program.parallel()}"

    def _goes_over(self, node: ast.For, *functions: object) -> bool:
        call = node.iter
        return (
            isinstance(call, ast.Call)
            and isinstance(call.func, ast.Name | ast.Attribute)
            and self.source.meaning(call.func) in functions
        )

    def _range(self, node: ast.For) -> tuple[Value, Value, int]:
        call = node.iter
        if not (
            self._goes_over(node, range, words.apart)
            and isinstance(call, ast.Call)
            and 1 <= len(call.args) <= 3
            and not call.keywords
        ):
            raise self.source.error(
                node,
                "a loop is over range(...), apart(n) or unrolled(...); else use while",
            )
        bounds = [self.converted(a, "int", "a bound") for a in call.args[:2]]
        step = 1
        if len(call.args) == 3:
            [step] = self.fold_integers(call.args[2:], "step")
            if step == 0:
                raise self.source.error(node, "the step is zero")
        start = bounds[0] if len(bounds) == 2 else Value("0", "int")
        return start, bounds[-1], step

    def _unrolled(self, node: ast.For) -> None:
        name = getattr(node.target, "id", "")
        if name in self.loops or name in self.kinds:
            raise self.source.error(
                node, f"`{name}` is taken; an unrolled loop wants a name of its own"
            )
        at_break: list[frozenset[str]] = []
        after = self.name("endunrolled")
        for _ in self.unrolled_values(node.target, node.iter):
            if not self.live:
                continue
            loop = _Loop(after, self.name("next"), at_break, [])
            self._body(node, loop)
            if self.live:
                loop.at_next.append(frozenset(self.assigned))
            self._leave(loop.next)
            if loop.at_next:
                self._begin(loop.next, frozenset.intersection(*loop.at_next))
        if self.live:
            at_break.append(frozenset(self.assigned))
        self._leave(after)
        self._after(_Loop(after, after, at_break, []))

    def _body(self, node: ast.While | ast.For, loop: _Loop) -> None:
        self.loops_around.append(loop)
        self.block(node.body)
        self.loops_around.pop()

    def _after(self, loop: _Loop) -> None:
        """Go on behind a loop, if something leads there."""
        self.live = False
        if loop.at_break:
            self._begin(loop.after, frozenset.intersection(*loop.at_break))

    def _break(self, node: ast.Break) -> None:  # noqa: ARG002
        loop = self.loops_around[-1]
        loop.at_break.append(frozenset(self.assigned))
        self._leave(loop.after)

    def _continue(self, node: ast.Continue) -> None:  # noqa: ARG002
        loop = self.loops_around[-1]
        loop.at_next.append(frozenset(self.assigned))
        self._leave(loop.next)

    def _no_else(self, node: ast.While | ast.For) -> None:
        if node.orelse:
            raise self.source.error(node, "a loop has no else; use a flag")


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
