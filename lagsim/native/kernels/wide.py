"""Kernels of several states at once: the same text, each number LANES of them.

Memories and arrays are interleaved: element k of lane l lies at k*LANES + l. Each lane
has the bits that the kernel gives by itself. Integers, with sizes, bounds of loops and
indices, are the same in all lanes: what is made of a float by `int` is that of the
first one. Where a condition of floats differs among lanes both ways are gone, and each
lane keeps what is stored on its own. Two things cannot be had: `break` and `continue`
under such a condition. A vector has one element here: lanes are what is side by side.

A function given at link time is another one here, of the name `symbol` gives: all that
it takes are addresses, numbers too.
"""

from __future__ import annotations

import ast

from lagsim.native.kernels.lines import LLVM, Value, stack_place
from lagsim.native.kernels.wide_values import (
    ALL,
    FLAGS,
    TYPES,
    VECTOR,
    WIDEST,
    WideValues,
)


class Wide(WideValues):
    """One function, of LANES states."""

    def definition(self, name: str, linkage: str) -> str:
        """Give the text of the function."""
        source = self.source
        parameters = []
        for parameter, kind in source.parameters:
            parameters.append(f'{TYPES[kind]} %"{parameter}"')
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
            self.allocated.append(f"  %result = alloca {TYPES[source.result]}")
        self.block(source.node.body)
        if self._open:
            self._give_back()
        head = (
            f"define {linkage}{TYPES[source.result]} @{name}"
            f"({', '.join(parameters)}) nounwind {WIDEST} {{"
        )
        return "\n".join([head, "entry:", *self.allocated, *self.lines, "}\n"])

    def _give_back(self) -> None:
        kind = TYPES[self.source.result]
        if self.source.result == "None":
            self.lines.append("  ret void")
        else:
            self.lines.append(f"  %result.{len(self.lines)} = load {kind}, ptr %result")
            self.lines.append(f"  ret {kind} %result.{len(self.lines) - 1}")
        self._open = False

    # Calls.

    def _call_kernel(self, node: ast.Call, function: object) -> Value:
        name, source = self.program.callee(function)  # type: ignore[arg-type]
        arguments = self._arguments(node, len(source.parameters))
        passed = []
        for argument, (parameter, kind) in zip(
            arguments, source.parameters, strict=True
        ):
            what = f"argument `{parameter}` of {source.name}"
            wanted = "flags" if kind == "bool" else kind
            value = self.converted(argument, wanted, what)
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
        call = f"call {TYPES[source.result]} @{name}({', '.join(passed)})"
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
                llvm = TYPES[kind]
                old = self._one(wanted, f"load {llvm}, ptr %result").text
                two = f"{llvm} {value.text}, {llvm} {old}"
                value = self._one(wanted, f"select {FLAGS} {self._mask()}, {two}")
            self.lines.append(f"  store {TYPES[kind]} {value.text}, ptr %result")
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
