"""Graph -> a tape for each function of a model, and the interpreter of the tapes.

Replaces `straight_line` for large models, and for long functions that are called
rarely. A tape is data: only the interpreter is compiled, and results have equal bits.

An instruction is an opcode, a number of fields, a count, and that many groups of
fields, one for each evaluation: indices into p (32 bits) of its result and of its
operands. Evaluations of
one kind and one level (one above the highest level of the operands) share one
instruction, so that the interpreter decodes few instructions: a large model repeats its
kinds of operations body by body. Truth values are 0 and 1.
"""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.language.elements import payload
from lagsim.language.functions import ELEMENTS, JOINING, OPERATIONS, PART, SMOOTH
from lagsim.language.graph import DATA, VARIABLE
from lagsim.native.graph.keys import PLAIN
from lagsim.native.graph.lines import (
    CIRCULAR,
    CLEAR,
    LANES,
    Code,
    Lines,
    clearing,
    exponent_of,
    fixed_nodes,
    number,
)  # fmt: skip
from lagsim.native.graph.members import MembersFunction, name_of, words

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Ints
    from lagsim.language.graph import Graph
    from lagsim.language.tables import Data
    from lagsim.native.graph.keys import Layout, Manner


SIGNATURE = "double %t, ptr %y, ptr %p, ptr %out"


class OperationKind(NamedTuple):
    """An operation, the exponent of a power, and which operands are products.

    An evaluation computes these products, too: most operations of an elimination are
    a - b*c.

    Attributes
    ----------
    op : str
    exponent : float or None
    products : tuple of bool
        Marks operands that are products of two fields.
    data : tuple of Data
        Constant arrays, which precede the other operands.
    """

    op: str
    exponent: float | None = None
    products: tuple[bool, ...] = ()
    data: tuple[Data, ...] = ()


# Fields of a STORE: index in p, index in out. Sine and cosine of LANES angles: indices
# of the sines, of the cosines, of the angles.
STORE, SINCOS = map(OperationKind, ("store", "sincos"))
STORE_FIELDS, SINCOS_FIELDS = 2, 3 * LANES
STOP = 0
# Numbers of an instruction before its fields: opcode, fields, count.
HEAD = 3
SUMS = ("add", "sub")


class Tasks(NamedTuple):
    """The evaluations of all functions, in an order that suits every function.

    Attributes
    ----------
    groups : (N,) int array
        Number of the group of each evaluation: all evaluations of one kind and level.
        Ascending, and greater than the groups of its operands.
    opcodes : (N,) int array
    users : (N,) int array
        Bit k is set if function k uses the evaluation.
    widths : (N,) int array
        Number of fields of each evaluation.
    fields : int array
        For each evaluation in turn, the result node, then the operand nodes.
    """

    groups: Ints
    opcodes: Ints
    users: Ints
    widths: Ints
    fields: Ints


def generate(
    g: Graph,
    functions: Mapping[str, Sequence[int]],
    layout: Layout,
    manner: Manner = PLAIN,
) -> Code:
    """Return the IR of `functions`, which run from tapes.

    functions : name -> the nodes written to out[0], out[1], ...
    manner : functions with results that are not stored where they are 0.
    """
    tapes = _Tapes(g, layout, functions)
    lines = tapes.functions(functions, tapes.state, blank=dict(manner.blank))
    lines += _function("prepare", tapes.tape(len(functions), ()), tapes.filled)
    declared, interpreter = tapes.interpreter()
    text = [*sorted(declared), *lines, *interpreter, ""]
    return Code("\n".join(text), tapes.size)


def tape_functions(
    g: Graph,
    functions: Mapping[str, Sequence[int]],
    layout: Layout,
    known: Mapping[int, int],
    calls: Mapping[str, Sequence[str]],
) -> tuple[set[str], list[str], int]:
    """Return declarations, lines and required length of p of functions on tapes.

    For a module of straight-line code: its function `prepare` evaluates no node of
    these functions.

    Parameters
    ----------
    g : Graph
    functions : mapping of str to sequence of node
        By name: the nodes written to out[0], out[1], ...
    layout : Layout
    known : mapping of int to int
        Nodes with values in p: node -> index.
    calls : mapping of str to sequence of str
        Functions that each function calls first, which store the known values.
    """
    tapes = _Tapes(g, layout._replace(fixed=frozenset()), functions, known)
    lines = tapes.functions(functions, f"{tapes.state}\n{tapes.filled}", calls)
    declared, interpreter = tapes.interpreter()
    return declared, [*lines, *interpreter], tapes.size


def _copied(array: str, name: str, first: int, count: int) -> str:
    """Return IR that copies the first numbers of `array` to p.

    name : a fresh name.
    first : index in p of the first number.
    count : the count of the numbers.
    """
    return (
        f"%{name} = getelementptr double, ptr %p, i64 {first}\ncall void "
        f"@llvm.memcpy.p0.p0.i64(ptr %{name}, ptr {array}, i64 {8 * count}, i1 0)"
    )


def _function(name: str, tape: Ints, before: str) -> list[str]:
    """Return the IR of a function that runs `tape`, after the code `before`."""
    data = tape.tobytes()
    text = "\\" + data.hex("\\")
    return [
        f'@tape.{name} = private constant [{len(data)} x i8] c"{text}", align 4',
        f"define void @{name}({SIGNATURE}) {{",
        before,
        f"call void @tape.run(ptr @tape.{name}, {SIGNATURE})",
        "ret void",
        "}",
    ]


def by_columns(tape: bytes) -> bytes:
    """Return the instructions of a tape in an order that compresses well.

    The heads of all instructions and 0 come first, then the columns of the fields of
    each instruction. The differences of successive numbers are stored, with the sign in
    the last bit: the first byte of each, then the second byte of each, and so on.
    """
    words = np.frombuffer(tape, "<i4").astype(np.int64)
    heads: list[int] = []
    columns: list[Ints] = []
    at = 0
    while words[at]:
        _, width, count = head = words[at : at + HEAD].tolist()
        first = at + HEAD
        at = first + width * count
        heads += head
        columns.append(words[first:at].reshape(count, width).T.ravel())
    change = np.diff(np.concatenate([[*heads, 0], *columns]), prepend=0)
    coded = (change << 1 ^ change >> 63).astype("<u4")
    return coded.view(np.uint8).reshape(-1, 4).T.tobytes()


class _Tapes:
    """The tapes of all functions, which share constants and memory in p.

    Attributes
    ----------
    index : (len(g) + 1,) int array
        Index in p of each node. The last entry, of node -1, is a dummy for unused lanes
        of sines and cosines.
    fixed : set of int
        Nodes whose values are in p: the nodes of `prepare`, and `stored`.
    stored : mapping of int to int
        Nodes that other functions have evaluated, with the index in p of each.
    time, states : int
        Index of t in p, which y follows, and the length of y.
    size : int
        The length of p.
    opcodes : dict
        Opcode of each kind that occurs.
    state, filled : str
        Code that copies y, and the constants, to p.
    table : str
        Declaration of the constants.
    """

    def __init__(
        self,
        g: Graph,
        layout: Layout,
        functions: Mapping[str, Sequence[int]],
        stored: Mapping[int, int] = {},
    ) -> None:
        self.g, self.layout = g, layout
        self.opcodes: dict[tuple[Any, ...], int] = {STORE: 1}
        self.plain: dict[str, int] = {}  # numbers of operations on values alone
        cone = g.cone(chain.from_iterable(functions.values()), stored)
        known = fixed_nodes(g, functions, layout.fixed)
        # An element of a vector of sums has the index that it has in the vector.
        fixed = [n for n in known if g.ops[n] != PART]
        self.parts = [n for n in cone if g.ops[n] == PART]
        self.vectors = {n: words(payload(g, n)) for n in cone if g.ops[n] == ELEMENTS}
        leaves = [n for n in cone if not g.args[n]]
        numbers = [n for n in leaves if g.ops[n] not in (VARIABLE, DATA)]
        first = layout.size + len(fixed)
        self.time = first + len(numbers)
        read = {g.payload(n) for n in leaves if g.ops[n] == VARIABLE}
        self.states = 1 + max([k for x, k in layout.y.items() if x in read] or (-1,))
        self.first = self.time + self.states + 2  # index of a function's own values
        self.size = self.first
        self.index = np.full(len(g) + 1, self.first - 1, np.int32)
        self.index[fixed] = range(layout.size, first)
        self.index[numbers] = range(first, self.time)
        places = {"t": self.time, **layout.p}
        places |= {name: self.time + 1 + k for name, k in layout.y.items()}
        for n in leaves:
            if g.ops[n] == VARIABLE:
                self.index[n] = places[g.payload(n)]
        self.stored = stored
        for n in stored:
            self.index[n] = stored[n]
        self.fixed = {*fixed, *stored}
        cone = [n for n in cone if n not in stored]
        self.tasks = self._tasks(cone, [*functions.values(), fixed])
        self.state = _copied("%y", "state", self.time + 1, self.states)
        self.filled = _copied("@numbers", "numbers", first, len(numbers))
        values = [f"double {number(float(g.payload(n)))}" for n in numbers]
        table = f"[{len(values)} x double] [{', '.join(values)}]"
        self.table = f"@numbers = private constant {table}"

    def functions(
        self,
        functions: Mapping[str, Sequence[int]],
        before: str,
        calls: Mapping[str, Sequence[str]] = {},
        blank: Mapping[str, int] = {},
    ) -> list[str]:
        """Return the IR of the functions.

        before : code that each function executes first.
        calls : functions that each function calls before that code.
        blank : see `keys.Manner`.
        """
        lines = []
        for k, (name, made) in enumerate(functions.items()):
            places = self.places(made)
            count = sum(places[-1][1:]) if places else 0
            called = [f"call void @{x}({SIGNATURE})" for x in calls.get(name, ())]
            cleared = clearing(count, min(count, blank.get(name, 0)))
            text = "\n".join([*called, cleared, before])
            lines += _function(name, self.tape(k, made), text)
        return lines

    def places(self, results: Sequence[int]) -> list[tuple[int, int, int]]:
        """Return triples: result node, its first index in out, its count of numbers.

        results : the nodes in the order of out.
        """
        g, found, at = self.g, [], 0
        for n in results:
            count = payload(g, n).size if n in self.vectors else 1
            found.append((n, at, count))
            at += count
        return found

    def interpreter(self) -> tuple[set[str], list[str]]:
        """Return declarations and lines of the interpreter of the tapes so far."""
        kinds = {OperationKind(*kind): opcode for kind, opcode in self.opcodes.items()}
        whole = Interpreter(kinds, self.time)
        return whole.declared, [self.table, *whole.lines]

    def _tasks(self, cone: Sequence[int], functions: Sequence[Sequence[int]]) -> Tasks:
        """Return the table of the evaluations of nodes that the functions need.

        cone : the nodes, in order of evaluation.
        functions : the results of each function; `prepare` is the last.
        """
        ops, args, plain = self.g.ops, self.g.args, self.plain
        users, inner = self._users(cone, functions)
        level = [0] * len(args)
        nodes, opcodes, widths, fields = [], [], [], []
        for n in cone:
            operands: Sequence[int] = args[n]
            if operands:
                level[n] = max(map(level.__getitem__, operands))
                if not inner[n] and ops[n] != PART:
                    level[n] += 1
                    opcode = plain.get(ops[n])
                    if opcode is None or inner[operands[0]] or inner[operands[-1]]:
                        opcode, operands = self._kind(n, inner)
                    nodes.append(n)
                    opcodes.append(opcode)
                    widths.append(1 + len(operands))
                    fields.append(n)
                    fields += operands
        levels = [level[n] for n in nodes]
        found = [levels, opcodes, [users[n] for n in nodes], widths]
        levels, opcodes, masks, widths = table = np.array(found, int)
        flat, starts = np.array(fields, int), np.cumsum(widths) - widths
        # Sine and cosine of one angle stand side by side.
        order = np.lexsort((flat[starts + 1], opcodes, levels))
        levels, opcodes, masks, widths = table[:, order]
        new = (np.diff(levels, prepend=-1) != 0) | (np.diff(opcodes, prepend=-1) != 0)
        shift = starts[order] - (np.cumsum(widths) - widths)
        flat = flat[np.repeat(shift, widths) + np.arange(len(flat))]
        return Tasks(np.cumsum(new), opcodes, masks, widths, flat)

    def _users(
        self, cone: Sequence[int], functions: Sequence[Sequence[int]]
    ) -> tuple[list[int], list[bool]]:
        """Return two lists with an entry for each node of the graph.

        The first: a bit mask of the functions that use the node. The second: whether
        the node is inner: a product whose only use in each function is a sum, so that
        the evaluation of the sum computes the product.

        cone : the nodes that are evaluated.
        functions : the results of each function.
        """
        ops, args = self.g.ops, self.g.args
        users, inner = [0] * len(args), [op == "mul" for op in ops]
        for n in self.stored:
            inner[n] = False
        for k, roots in enumerate(functions):
            for n in roots:
                users[n] |= 1 << k
                inner[n] = False
        for n in self.fixed:
            users[n] = 1 << (len(functions) - 1)
        for n in reversed(cone):
            users_of_node, term = users[n], ops[n] in SUMS
            for a in args[n]:
                if not term or users[a] & users_of_node:
                    inner[a] = False
                if a not in self.fixed:
                    users[a] |= users_of_node
        return users, inner

    def _kind(self, n: int, inner: Sequence[bool]) -> tuple[int, Sequence[int]]:
        """Return the opcode of the evaluation of node n, and its operand nodes.

        inner : whether each node is an inner node, see `_users`.
        """
        g = self.g
        op, args = g.ops[n], g.args[n]
        if op in CIRCULAR:
            return self.opcodes.setdefault(SINCOS, 1 + len(self.opcodes)), args
        arrays = OPERATIONS[op].data
        data = tuple(map(g.payload, args[:arrays]))
        args = args[arrays:]
        products = tuple([inner[a] for a in args])
        if True in products:
            several = [g.args[a] if inner[a] else (a,) for a in args]
            args = tuple(chain.from_iterable(several))
        kind = op, exponent_of(g, n), products, data
        opcode = self.opcodes.setdefault(kind, 1 + len(self.opcodes))
        if op != "pow" and not arrays and True not in products:
            self.plain[op] = opcode
        return opcode, args

    def tape(self, k: int, results: Sequence[int]) -> Ints:
        """Return the tape of function number k as an array of int32.

        results : the nodes written to out.
        """
        tasks, index = self.tasks, self.index
        chosen = tasks.users >> k & 1 == 1
        fields = tasks.fields[np.repeat(chosen, tasks.widths)]
        widths = tasks.widths[chosen]
        starts = np.append(0, np.cumsum(widths))
        places = self.places(results)
        new = [n for n in fields[starts[:-1]].tolist() if n not in self.fixed]
        lengths = [self.vectors.get(n, 1) for n in new]
        ends = self.first + np.cumsum(lengths, dtype=int)
        index[new] = ends - lengths
        self.size = max(self.size, int(ends[-1]) if new else self.first)
        for n in self.parts:
            vector, k = self.g.args[n]
            index[n] = index[vector] + int(self.g.payload(k))
        # The instructions, each with its head before its fields.
        firsts = np.flatnonzero(np.diff(tasks.groups[chosen], prepend=-1))
        opcodes = tasks.opcodes[chosen][firsts]
        counts = np.diff(firsts, append=len(widths))
        heads = np.column_stack([opcodes, widths[firsts], counts])
        starts = starts[[*firsts, -1]]
        code = np.insert(index[fields], np.repeat(starts[:-1], HEAD), heads.ravel())
        pieces, at = [], 0
        for j in np.flatnonzero(opcodes == self.opcodes.get(SINCOS, STOP)):
            pieces.append(code[at : starts[j] + HEAD * j])
            pieces.append(self._sincos(fields[starts[j] : starts[j + 1]]))
            at = starts[j + 1] + HEAD * (j + 1)
        pieces.append(code[at:])
        stored = [
            (index[n] + i, j + i)
            for n, j, count in places
            if n != self.g.zero
            for i in range(count)
        ]
        if stored:
            pieces.append(np.array([self.opcodes[STORE], STORE_FIELDS, len(stored)]))
            pieces.append(np.array(sorted(stored)).ravel())
        return np.concatenate([*pieces, [STOP]]).astype(np.int32)

    def _sincos(self, fields: Ints) -> Ints:
        """Return the tape's instruction for sines and cosines, as an array of integers.

        fields : pairs (node, angle), sorted by angle; a node is a sine or a cosine.
        """
        nodes, angles = fields.reshape(-1, 2).T
        angles, lane = np.unique(angles, return_inverse=True)
        count = -(-len(angles) // LANES)
        table = np.full((3, count * LANES), -1)
        table[[CIRCULAR[self.g.ops[n]] for n in nodes], lane] = nodes
        table[2] = angles[-1]
        table[2, : len(angles)] = angles
        sets = table.reshape(3, count, LANES).swapaxes(0, 1)
        head = [self.opcodes[SINCOS], SINCOS_FIELDS, count]
        return np.append(head, self.index[sets])


class Interpreter(Lines):
    """Writer of the function that runs a tape, with one loop for each opcode."""

    def __init__(self, opcodes: Mapping[OperationKind, int], time: int) -> None:
        super().__init__()
        self.declared.add("declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)")
        self.declared.add(CLEAR)
        self.others: list[str] = []
        for kind, k in opcodes.items():
            self.lines += [
                f"op{k}:",
                f"%count{k} = getelementptr i32, ptr %pc, i64 {HEAD - 1}",
                f"%times{k} = load i32, ptr %count{k}",
                f"%first{k} = getelementptr i32, ptr %pc, i64 {HEAD}",
                f"br label %loop{k}",
                f"loop{k}:",
                f"%at{k} = phi ptr [%first{k}, %op{k}], [%after{k}, %loop{k}]",
                f"%left{k} = phi i32 [%times{k}, %op{k}], [%less{k}, %loop{k}]",
            ]
            width = self._evaluation(kind, f"%at{k}")
            self.lines += [
                f"%after{k} = getelementptr i32, ptr %at{k}, i64 {width}",
                f"%less{k} = sub i32 %left{k}, 1",
                f"%more{k} = icmp ne i32 %less{k}, 0",
                f"br i1 %more{k}, label %loop{k}, label %next",
            ]
        codes = opcodes.values()
        ends = "".join(f", [%after{k}, %loop{k}]" for k in codes)
        cases = " ".join(f"i32 {k}, label %op{k}" for k in codes)
        self.lines = [
            f"define internal void @tape.run(ptr readonly %tape, {SIGNATURE}) {{",
            "begin:",
            f"%time = getelementptr double, ptr %p, i64 {time}",
            "store double %t, ptr %time",
            "br label %next",
            "next:",
            f"%pc = phi ptr [%tape, %begin]{ends}",
            "%opcode = load i32, ptr %pc",
            f"switch i32 %opcode, label %stop [{cases}]",
            *self.lines,
            "stop:",
            "ret void",
            "}",
            *self.others,
        ]

    def _evaluation(self, kind: OperationKind, at: str) -> int:
        """Write the code of one evaluation; return the number of its fields.

        kind : the kind of the operation.
        at : the name of the address of its fields.
        """
        if kind == STORE:
            self._store(self._load("p", at, 0), "out", at, 1)
            return STORE_FIELDS
        if kind == SINCOS:
            angles = [self._load("p", at, 2 * LANES + k) for k in range(LANES)]
            outputs = [(op, k) for op in CIRCULAR for k in range(LANES)]
            for k, value in enumerate(self.circular(angles, outputs)):
                self._store(value, "p", at, k)
            return SINCOS_FIELDS
        if kind.op == ELEMENTS:
            of: Any = kind.data[0]
            function = MembersFunction(of)
            self.declared |= function.declared
            self.others += function.lines
            self.lines.append(f"call void @{name_of(of)}(ptr {at}, ptr %p)")
            return 1 + int(of.count)
        fields, operands = 1, [self.data(data) for data in kind.data]
        for place, product in enumerate(kind.products):
            value = self._load("p", at, fields)
            fields += 1
            if product:
                other = self._load("p", at, fields)
                value = self.operation("mul", None, [value, other])
                fields += 1
            if kind.op in JOINING or (kind.op in ("if", SMOOTH) and place == 0):
                value = self.line(f"fcmp one double {value}, 0.0")
            operands.append(value)
        value = self.operation(kind.op, kind.exponent, operands)
        if OPERATIONS[kind.op].condition:
            value = self.line(f"uitofp i1 {value} to double")
        self._store(value, "p", at, 0)
        return fields

    def _address(self, array: str, at: str, k: int) -> str:
        """Write IR that computes the address of an element of `array`; return its name.

        The index of the element is the integer number k after the pointer `at`, which
        points to the fields of one evaluation on the tape.
        """
        field = self.line(f"getelementptr inbounds i32, ptr {at}, i64 {k}")
        index = self.line(f"load i32, ptr {field}")
        return self.line(f"getelementptr inbounds double, ptr %{array}, i32 {index}")

    def _load(self, array: str, at: str, k: int) -> str:
        return self.line(f"load double, ptr {self._address(array, at, k)}")

    def _store(self, value: str, array: str, at: str, k: int) -> None:
        self.lines.append(f"store double {value}, ptr {self._address(array, at, k)}")
