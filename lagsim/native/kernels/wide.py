"""Kernels of several states at once: the same text, each number LANES of them.

Memories and arrays are interleaved: element k of lane l lies at k*LANES + l. Each lane
has the bits that the kernel gives by itself. Integers, with sizes, bounds of loops and
indices, are the same in all lanes: what is made of a float by `int` is that of the
first one. Where a condition of floats differs among lanes both ways are gone, and each
lane keeps what is stored on its own. Two things cannot be had: `break` and `continue`
under such a condition.

A function given at link time is another one here, of the name `symbol` gives: all that
it takes are addresses, numbers too.
"""

from __future__ import annotations

import ast
import re
from typing import TYPE_CHECKING, Final

from lagsim.native.kernels.lines import LANES, LLVM, UNOPTIMISED, Value, stack_place
from lagsim.native.kernels.source import Source
from lagsim.native.kernels.statements import Statements
from lagsim.native.kernels.words import is_rare
from lagsim.native.layout import NUMBER, SIZE

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.native.kernels.lines import Program
    from lagsim.native.kernels.source import Static

VECTOR: Final = f"<{LANES} x double>"
WHOLE: Final = f"<{LANES} x i64>"
FLAGS: Final = LLVM["flags"]
ALL: Final = f"<{', '.join(['i1 true'] * LANES)}>"
_TYPES: Final = LLVM | {"float": VECTOR, "bool": FLAGS}
# LLVM prefers two registers of half the length on some processors.
WIDEST: Final = (
    '"prefer-vector-width"="512" "min-legal-vector-width"="512"'
)


# A type, and no part of a vector that is written out.
_NUMBER: Final = re.compile(r"\bdouble\b(?! 0x)")


def _widened(text: str) -> str:
    return _NUMBER.sub(VECTOR, text)


def symbol(name: str) -> str:
    """Give the symbol of a function of a model that takes LANES states at once."""
    return f"{name}.lanes"


def declaration(source: Source) -> str:
    """Give that of an external."""
    pointers = ", ".join("ptr" for _ in source.parameters)
    return f"declare void @{symbol(source.name)}({pointers}) nounwind"


class Wide(Statements):
    """One function, of LANES states."""

    def __init__(self, source: Source, program: Program) -> None:
        super().__init__(source, program)
        self._masks: list[str] = []  # of the conditions around the present place
        self._open = True  # whether its block has no end yet

    # The function.

    def definition(self, name: str, linkage: str) -> str:
        """Give the text of the function."""
        source = self.source
        parameters = []
        for parameter, kind in source.parameters:
            parameters.append(f'{_TYPES[kind]} %"{parameter}"')
            value = Value(f'%"{parameter}"', "flags" if kind == "bool" else kind)
            self._store_name(source.node, parameter, value)
        self.allocated.append(f"  %alive = alloca {FLAGS}")
        mask = ALL
        if linkage:
            parameters.append(f"{FLAGS} %alive.0")
            mask = "%alive.0"
        elif any(kind != "Floats" for _, kind in source.parameters):
            raise source.error(source.node, "one that is called takes arrays alone")
        self.allocated.append(f"  store {FLAGS} {mask}, ptr %alive")
        if source.result != "None":
            self.allocated.append(f"  %result = alloca {_TYPES[source.result]}")
        self.block(source.node.body)
        if self._open:
            self._give_back()
        manner = f" {UNOPTIMISED}" if is_rare(source.function) else ""
        head = (
            f"define {linkage}{_TYPES[source.result]} @{name}"
            f"({', '.join(parameters)}) nounwind{manner} {WIDEST} {{"
        )
        return "\n".join([head, "entry:", *self.allocated, *self.lines, "}\n"])

    def _give_back(self) -> None:
        kind = _TYPES[self.source.result]
        if self.source.result == "None":
            self.lines.append("  ret void")
        else:
            self.lines.append(f"  %result.{len(self.lines)} = load {kind}, ptr %result")
            self.lines.append(f"  ret {kind} %result.{len(self.lines) - 1}")
        self._open = False

    # Blocks.

    def start(self, label: str) -> None:
        """Start the block `label`."""
        super().start(label)
        self._open = True

    def jump(self, label: str) -> None:
        """End a block by going to `label`."""
        super().jump(label)
        self._open = False

    def branch(self, test: Value, yes: str, no: str) -> None:
        """End a block by going to one of two labels."""
        super().branch(test, yes, no)
        self._open = False

    def _leave(self, label: str) -> None:
        if self._open:
            self.jump(label)
        self.live = False

    # Values.

    def op(self, kind: str, text: str) -> Value:
        """Add an instruction with a result."""
        if kind == "Floats":
            text = text.replace(
                "getelementptr inbounds double", f"getelementptr inbounds {VECTOR}"
            )
        elif kind == "float":
            align = ", align 8" if text.startswith("load") else ""
            text = text.replace("select i1", f"select {FLAGS}")
            text = _widened(text) + align
        elif text.startswith("fcmp"):
            return super().op("flags", _widened(text))
        return super().op(kind, text)

    def _one(self, kind: str, text: str) -> Value:
        """Add an instruction on one number."""
        return super().op(kind, text)

    def _spread(self, value: Value, kind: str, llvm: str) -> Value:
        """Give all lanes the same."""
        one = f"insertelement <{LANES} x {llvm}> poison, {llvm} {value.text}, i32 0"
        first = self._one(kind, one).text
        vector = f"<{LANES} x {llvm}>"
        rest = f"{vector} poison, <{LANES} x i32> zeroinitializer"
        return self._one(kind, f"shufflevector {vector} {first}, {rest}")

    def _lane(self, value: Value, lane: int) -> Value:
        """Give the number of a lane."""
        return self._one("one", f"extractelement {VECTOR} {value.text}, i32 {lane}")

    def literal(self, node: ast.AST, known: Static) -> Value:
        """Give a number or a condition known at translation."""
        value = super().literal(node, known)
        if value.kind != "float":
            return value
        return Value(f"<{', '.join([f'double {value.text}'] * LANES)}>", "float")

    def cast(self, value: Value, kind: str, node: ast.AST, what: str) -> Value:
        """Convert what is the same in all lanes to what need not be."""
        if (value.kind, kind) == ("int", "float"):
            one = self._one("one", f"sitofp i64 {value.text} to double")
            return self._spread(one, "float", "double")
        if (value.kind, kind) == ("bool", "flags"):
            return self._spread(value, "flags", "i1")
        if (value.kind, kind) == ("flags", "bool"):
            return value
        return super().cast(value, kind, node, what)

    def allocate(self, stem: str, kind: str) -> str:
        """Give a new variable its place on the stack."""
        place = self.name(stem)
        llvm = VECTOR if kind == "float" else LLVM[kind]
        self.allocated.append(f"  {place} = alloca {llvm}")
        return place

    def store(self, value: Value, place: str) -> None:
        """Store a value, in all lanes."""
        llvm = VECTOR if value.kind == "float" else LLVM[value.kind]
        align = ", align 8" if value.kind == "float" else ""
        self.lines.append(f"  store {llvm} {value.text}, ptr {place}{align}")

    def libm(self, name: str, *values: Value) -> Value:
        """Call a function of the C library, lane by lane."""
        found = "poison"
        for lane in range(LANES):
            numbers = [self._lane(value, lane) for value in values]
            types = ", ".join("double" for _ in values)
            self.program.declare(
                f"declare double @{name}({types}) nounwind memory(none)"
            )
            passed = ", ".join(f"double {v.text}" for v in numbers)
            call = f"call double @{name}({passed}) nobuiltin nounwind memory(none)"
            one = self._one("one", call).text
            place = f"insertelement {VECTOR} {found}, double {one}, i32 {lane}"
            found = self._one("float", place).text
        return Value(found, "float")

    def intrinsic(self, name: str, *values: Value) -> Value:
        """Emit a function that is exact in IEEE 754."""
        types = ", ".join(VECTOR for _ in values)
        self.program.declare(f"declare {VECTOR} @llvm.{name}.v{LANES}f64({types})")
        passed = ", ".join(f"{VECTOR} {v.text}" for v in values)
        call = f"call {VECTOR} @llvm.{name}.v{LANES}f64({passed})"
        return self._one("float", call)

    def bits(self, text: str) -> Value:
        """Add an instruction on the bits of numbers."""
        operation, _, rest = text.partition(" ")
        if operation != "bitcast":
            *rest_, last = rest.split(", ")
            each = ", ".join([f"i64 {last}"] * LANES)
            rest = f"{', '.join(rest_)}, <{each}>"
            kind, _, value = rest.partition(" ")
            return self._one("bits", f"{operation} {WHOLE} {value}")
        rest = _widened(rest).replace("i64", WHOLE)
        return self._one("bits", f"{operation} {rest}")

    def _truncated(self, value: Value) -> Value:
        return super()._truncated(self._lane(value, 0))

    def _load_field(self, node: ast.Attribute) -> Value:
        memory, place, field = self.word(node)
        if field.kind == NUMBER:
            return self.op("float", f"load double, ptr {place}")
        load = f"load double, ptr {place}, align 8, !invariant.load !{{}}"
        value = self._one("one", load)
        whole = self._one("int", f"fptosi double {value.text} to i64")
        if field.kind == SIZE:
            return whole
        text = f"getelementptr inbounds double, ptr {memory}, i64 {whole.text}"
        return self.op("Floats", text)

    # Conditions.

    def condition(self, node: ast.expr) -> Value:
        """Emit an expression that must be a condition."""
        value = self.expression(node)
        return value if value.kind == "flags" else self._plain_condition(node, value)

    def _plain_condition(self, node: ast.expr, value: Value) -> Value:
        if value.kind != "bool":
            text = f"`{ast.unparse(node)}` is {value.kind}, not a condition"
            raise self.source.error(node, text)
        return value

    def _emit_unary(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            return self._opposite(self.condition(node.operand))
        return super()._emit_unary(node)

    def _opposite(self, test: Value) -> Value:
        if test.kind == "flags":
            return self._one("flags", f"xor {FLAGS} {test.text}, {ALL}")
        return self._one("bool", f"xor i1 {test.text}, true")

    def _both(self, operation: str, left: str, right: str) -> str:
        return self._one("flags", f"{operation} {FLAGS} {left}, {right}").text

    def _mask(self) -> str:
        """Give the lanes that the present place is reached in."""
        alive = self._one("flags", f"load {FLAGS}, ptr %alive").text
        return self._both("and", self._masks[-1], alive) if self._masks else alive

    def _any(self, mask: str) -> Value:
        bits = self._one("bits", f"bitcast {FLAGS} {mask} to i{LANES}").text
        return self._one("bool", f"icmp ne i{LANES} {bits}, 0")

    def _within(self, mask: str, make: Callable[[], Value]) -> Value:
        """Emit what is only wanted in some lanes."""
        self._masks.append(mask)
        value = make()
        self._masks.pop()
        return value

    def _lazily(
        self, first: Value, second: Callable[[], Value], *, until: bool
    ) -> Value:
        if first.kind == "bool":
            return self._lazily_all(first, second, until=until)
        wanted = self._opposite(first).text if until else first.text
        place = self.allocate("b", "flags")
        self.store(first, place)
        more, end = self.name("more"), self.name("end")
        mask = self._both("and", self._mask(), wanted)
        self.branch(self._any(mask), more, end)
        self.start(more)
        value = self._within(mask, second)
        value = self.cast(value, "flags", self.source.node, "a condition")
        either = self._both("or" if until else "and", first.text, value.text)
        self.store(Value(either, "flags"), place)
        self.jump(end)
        self.start(end)
        return self._one("flags", f"load {FLAGS}, ptr {place}")

    def _lazily_all(
        self, first: Value, second: Callable[[], Value], *, until: bool
    ) -> Value:
        """Do it where the first condition is the same in all lanes."""
        with self.aside() as lines:
            value = second()
        kind = value.kind
        place = self.allocate("b", kind)
        more, end = self.name("more"), self.name("end")
        same = self.cast(first, kind, self.source.node, "a condition")
        self.store(same, place)
        self.branch(first, *((end, more) if until else (more, end)))
        self.start(more)
        self.lines += lines
        self.store(value, place)
        self.jump(end)
        self.start(end)
        return self._one(kind, f"load {LLVM[kind]}, ptr {place}")

    def _emit_choice(self, node: ast.IfExp) -> Value:
        known = self.fold(node.test)
        if known is not None:
            return self.expression(node.body if known else node.orelse)
        with self.aside():
            kind = self.condition(node.test).kind
        if kind == "bool":
            return super()._emit_choice(node)
        test = self.condition(node.test)
        mask = self._mask()
        other = self._opposite(test)
        first = self._both("and", mask, test.text)
        second = self._both("and", mask, other.text)
        yes = self._within(first, lambda: self.expression(node.body))
        no = self._within(second, lambda: self.expression(node.orelse))
        if yes.kind == "int":
            yes = self.cast(yes, "float", node, "one of the two values")
        no = self.cast(no, yes.kind, node, "one of the two values")
        llvm = VECTOR if yes.kind == "float" else LLVM[yes.kind]
        text = f"select {FLAGS} {test.text}, {llvm} {yes.text}, {llvm} {no.text}"
        return self._one(yes.kind, text)

    # Calls.

    def _call_kernel(self, node: ast.Call, function: object) -> Value:
        name, source = self.program.callee(function)  # type: ignore[arg-type]
        arguments = self._arguments(node, len(source.parameters))
        passed = []
        for argument, (parameter, kind) in zip(
            arguments, source.parameters, strict=True
        ):
            what = f"argument `{parameter}` of {source.name}"
            kind = "flags" if kind == "bool" else kind
            value = self.converted(argument, kind, what)
            if source.external and kind == "float":
                place = self.allocate("number", "float")
                self.store(value, place)
                value = Value(place, "Floats")
            llvm = VECTOR if value.kind == "float" else LLVM[value.kind]
            passed.append(f"{llvm} {value.text}")
        if source.external:
            self.lines.append(f"  call void @{name}({', '.join(passed)})")
            return Value("", "None")
        passed.append(f"{FLAGS} {self._mask()}")
        call = f"call {_TYPES[source.result]} @{name}({', '.join(passed)})"
        if source.result == "None":
            self.lines.append(f"  {call}")
            return Value("", "None")
        return self._one("flags" if source.result == "bool" else source.result, call)

    # Statements.

    def _store_name(self, node: ast.AST, name: str, value: Value) -> None:
        if value.kind == "bool":
            value = self.cast(value, "flags", node, "")
        new = name not in self.kinds
        if new and value.kind == "float":
            self.kinds[name] = "float"
            self.allocated.append(f"  {stack_place(name)} = alloca {VECTOR}")
        kind = self.kinds.get(name, value.kind)
        if value.kind == kind == "int" and self._masks and name in self.assigned:
            self._demand_same(node, name)
        if not new and kind in ("float", "flags"):
            value = self.cast(value, kind, node, f"the value of `{name}`")
            llvm = VECTOR if kind == "float" else FLAGS
            load = f"load {llvm}, ptr {stack_place(name)}"
            load += ", align 8" if kind == "float" else ""
            old = self._one(kind, load).text
            two = f"{llvm} {value.text}, {llvm} {old}"
            value = self._one(kind, f"select {FLAGS} {self._mask()}, {two}")
        super()._store_name(node, name, value)

    def _demand_same(self, node: ast.AST, name: str) -> None:
        if not isinstance(node, ast.Name) or not isinstance(node.ctx, ast.Store):
            return
        if name not in self._counters:
            raise self.source.error(
                node, f"`{name}` is an integer, which is the same in all lanes"
            )

    @property
    def _counters(self) -> frozenset[str]:
        """The variables of loops."""
        loops = (x for x in ast.walk(self.source.node) if isinstance(x, ast.For))
        return frozenset(x.target.id for x in loops if isinstance(x.target, ast.Name))

    def _keep(self, value: Value, place: str) -> None:
        """Store a number in the lanes that the present place is reached in.

        As a whole, which a load that follows need not wait for.
        """
        old = self.op("float", f"load double, ptr {place}").text
        two = f"{VECTOR} {value.text}, {VECTOR} {old}"
        self.store(self._one("float", f"select {FLAGS} {self._mask()}, {two}"), place)

    def _store(self, target: ast.expr, value: Value) -> None:
        if isinstance(target, ast.Subscript | ast.Attribute):
            place = self._place(target)
            self._keep(self.cast(value, "float", target, "the value"), place)
        else:
            super()._store(target, value)

    def _augmented(self, node: ast.AugAssign) -> None:
        target = node.target
        if isinstance(target, ast.Subscript) or self.source.field(target):
            place = self._place(target)
            now = self.op("float", f"load double, ptr {place}")
            value = self.arithmetic(node, now, node.op, self.number(node.value))
            self._keep(self.cast(value, "float", node, "the value"), place)
        else:
            super()._augmented(node)

    def _if(self, node: ast.If) -> None:
        known = self.fold(node.test)
        if isinstance(known, bool):
            self.block(node.body if known else node.orelse)
            return
        test = self.condition(node.test)
        before, end = frozenset(self.assigned), self.name("endif")
        after: list[frozenset[str]] = []
        if test.kind == "flags":
            self._if_some(test, node, before, after)
            if after:
                self.assigned = set(frozenset.intersection(*after))
            self.live = bool(after)
            return
        yes, no = self.name("then"), self.name("else")
        self.branch(test, yes, no)
        reached = False
        for label, body in ((yes, node.body), (no, node.orelse)):
            self._begin(label, before)
            self.block(body)
            if self.live:
                after.append(frozenset(self.assigned))
            reached |= self._open
            self._leave(end)
        if reached:
            self._begin(end, frozenset.intersection(*after) if after else before)
            self.live = bool(after)

    def _if_some(
        self,
        test: Value,
        node: ast.If,
        before: frozenset[str],
        after: list[frozenset[str]],
    ) -> None:
        """Go both ways, each for the lanes that it is meant for."""
        mask, other = self._mask(), self._opposite(test)
        for some, body in ((test, node.body), (other, node.orelse)):
            self.assigned = set(before)
            self.live = True
            if body:
                wanted = self._both("and", mask, some.text)
                then, end = self.name("some"), self.name("all")
                self.branch(self._any(wanted), then, end)
                self.start(then)
                self._masks.append(wanted)
                self.block(body)
                self._masks.pop()
                self.jump(end)
                self.start(end)
            if self.live:
                after.append(frozenset(self.assigned))

    def _return(self, node: ast.Return) -> None:
        kind = self.source.result
        if kind != "None":
            assert node.value is not None
            wanted = "flags" if kind == "bool" else kind
            value = self.converted(node.value, wanted, "the result")
            if kind == "int":
                if self._masks:
                    raise self.source.error(node, "an integer is the same in all lanes")
            else:
                llvm = _TYPES[kind]
                old = self._one(wanted, f"load {llvm}, ptr %result").text
                two = f"{llvm} {value.text}, {llvm} {old}"
                value = self._one(wanted, f"select {FLAGS} {self._mask()}, {two}")
            self.lines.append(f"  store {_TYPES[kind]} {value.text}, ptr %result")
        if self._masks:
            alive = self._one("flags", f"load {FLAGS}, ptr %alive").text
            gone = self._opposite(Value(self._masks[-1], "flags")).text
            left = self._both("and", alive, gone)
            self.lines.append(f"  store {FLAGS} {left}, ptr %alive")
        else:
            self._give_back()
        self.live = False

    def _while(self, node: ast.While) -> None:
        with self.aside():
            same = self.condition(node.test).kind == "bool"
        if same:
            super()._while(node)
            return
        active = self.allocate("active", "flags")
        self.store(Value(self._mask(), "flags"), active)
        head, body, end = map(self.name, ("while", "do", "endwhile"))
        self.jump(head)
        self.start(head)
        before = frozenset(self.assigned)
        now = self._both(
            "and", self._one("flags", f"load {FLAGS}, ptr {active}").text, self._mask()
        )
        test = self._within(now, lambda: self.condition(node.test))
        now = self._both("and", now, test.text)
        self.store(Value(now, "flags"), active)
        self.branch(self._any(now), body, end)
        self.start(body)
        self._masks.append(now)
        self.block(node.body)
        self._masks.pop()
        if self._open:
            self.jump(head)
        self._begin(end, before)

    def _break(self, node: ast.Break) -> None:
        self._demand_no_mask(node)
        super()._break(node)

    def _continue(self, node: ast.Continue) -> None:
        self._demand_no_mask(node)
        super()._continue(node)

    def _demand_no_mask(self, node: ast.stmt) -> None:
        if self._masks:
            raise self.source.error(node, "lanes leave a loop by its condition alone")

    def _set_apart(self, first: int) -> None:
        """Leave loops as they are: what is made at once are lanes."""
