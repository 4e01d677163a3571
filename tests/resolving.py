"""What collecting tests would find, read from their text: it takes under a second.

Imports of `tests` and `lagsim`, wherever they stand, name what is there; marks are
known; every argument of a test is a parameter or a fixture.
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

OURS = ("tests", "lagsim")
MARK = re.compile(r"\bpytest\.mark\.(\w+)")
PYTESTS_MARKS = frozenset(
    (
        "filterwarnings",
        "parametrize",
        "skip",
        "skipif",
        "timeout",
        "usefixtures",
        "xfail",
    )
)
PYTESTS_FIXTURES = frozenset(
    ("cache", "capfd", "capfdbinary", "caplog", "capsys", "capsysbinary", "monkeypatch",
     "pytestconfig", "record_property", "recwarn", "request", "tmp_path",
     "tmp_path_factory")
)  # fmt: skip


def _inner(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """Give statements and those that stand in them."""
    for node in body:
        yield node
        for part in ("body", "orelse", "finalbody"):
            yield from _inner(getattr(node, part, []))
        for part in ("handlers", "cases"):
            for case in getattr(node, part, []):
                yield from _inner(case.body)


def _imported(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """Give what runs as a module is imported, also where it is run on a condition."""
    for node in body:
        yield node
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            yield from _imported(node.orelse)
            continue
        for part in ("body", "orelse", "finalbody"):
            yield from _imported(getattr(node, part, []))
        for handler in getattr(node, "handlers", []):
            yield from _imported(handler.body)


def _stored(node: ast.stmt) -> Iterator[str]:
    """Give the names that a statement binds."""
    match node:
        case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
            yield name
        case ast.Import() | ast.ImportFrom():
            for alias in node.names:
                yield alias.asname or alias.name.split(".")[0]
        case ast.Assign() | ast.AnnAssign() | ast.AugAssign() | ast.For() | ast.With():
            for inner in ast.walk(node):
                if isinstance(inner, ast.Name) and isinstance(inner.ctx, ast.Store):
                    yield inner.id


@dataclass
class Module:
    """A file of ours."""

    path: Path
    name: str
    is_package: bool

    @cached_property
    def text(self) -> str:
        return self.path.read_text("utf-8")

    @cached_property
    def tree(self) -> ast.Module:
        return ast.parse(self.text)

    @cached_property
    def imports(self) -> list[ast.Import | ast.ImportFrom]:
        """Those of the file and of its functions."""
        kinds = ast.Import | ast.ImportFrom
        return [n for n in _inner(self.tree.body) if isinstance(n, kinds)]

    @cached_property
    def kept(self) -> dict[str, ast.expr]:
        """Give what stands at the head of the file under a name of its own."""
        return {
            ast.unparse(node.targets[0]): node.value
            for node in self.tree.body
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
        }

    def marks(self, function: ast.FunctionDef) -> list[ast.Call]:
        """Give the marks of a function that are calls, also those kept under a name."""
        found = [
            self.kept.get(mark.id, mark) if isinstance(mark, ast.Name) else mark
            for mark in function.decorator_list
        ]
        return [mark for mark in found if isinstance(mark, ast.Call)]

    @cached_property
    def names(self) -> frozenset[str]:
        found = (_stored(node) for node in _imported(self.tree.body))
        return frozenset(name for names in found for name in names)

    @cached_property
    def functions(self) -> list[ast.FunctionDef]:
        classes = [n.body for n in self.tree.body if isinstance(n, ast.ClassDef)]
        bodies = [self.tree.body, *classes]
        return [n for b in bodies for n in b if isinstance(n, ast.FunctionDef)]


@dataclass
class Project:
    """The files below a folder that holds `tests` and `lagsim`."""

    root: Path
    marks: frozenset[str]
    modules: dict[str, Module] = field(init=False)

    def __post_init__(self) -> None:
        self.modules = {}
        for top in OURS:
            for path in sorted((self.root / top).rglob("*.py")):
                parts = path.relative_to(self.root).with_suffix("").parts
                package = parts[-1] == "__init__"
                name = ".".join(parts[:-1] if package else parts)
                self.modules[name] = Module(path, name, package)
        # Folders without __init__.py can be imported too.
        self.folders = {
            name[:k]
            for name in self.modules
            for k, letter in enumerate(name)
            if letter == "."
        }

    def faults(self) -> list[str]:
        """Give what cannot be collected, of all tests."""
        found = []
        for module in self.modules.values():
            if module.name.split(".")[0] == "tests":
                found += self._unresolved(module)
                found += self._unknown_marks(module)
                if module.path.name.startswith("test_"):
                    found += self._unknown_arguments(module)
        return found

    def _unresolved(self, module: Module) -> Iterator[str]:
        for node in module.imports:
            sources: list[tuple[str, str | None]]
            sources = [(alias.name, None) for alias in node.names]
            if isinstance(node, ast.ImportFrom):
                source = self._source(module, node)
                sources = [(source, alias.name) for alias in node.names]
            for source, name in sources:
                if source.split(".")[0] in OURS and not self._has(source, name):
                    what = f"{name} of {source}" if name else source
                    yield f"{module.path.name}:{node.lineno}: there is no {what}"

    def _source(self, module: Module, node: ast.ImportFrom) -> str:
        if not node.level:
            return node.module or ""
        parts = module.name.split(".")
        kept = parts[: len(parts) - node.level + module.is_package]
        return ".".join([*kept, *([node.module] if node.module else [])])

    def _has(self, source: str, name: str | None) -> bool:
        known = source in self.modules or source in self.folders
        if name is None or not known:
            return known
        inner = f"{source}.{name}"
        if inner in self.modules or inner in self.folders:
            return True
        module = self.modules.get(source)
        return bool(module and {name, "__getattr__"} & module.names)

    def _unknown_marks(self, module: Module) -> Iterator[str]:
        for name in sorted(set(MARK.findall(module.text))):
            if name not in self.marks | PYTESTS_MARKS:
                yield f"{module.path.name}: there is no mark {name}"

    def _unknown_arguments(self, module: Module) -> Iterator[str]:
        fixtures = PYTESTS_FIXTURES | self._fixtures(module)
        for function in module.functions:
            if not function.name.startswith("test_"):
                continue
            marks = module.marks(function)
            if any(
                _dotted(mark.func) in ("given", "hypothesis.given") for mark in marks
            ):
                continue  # hypothesis gives them
            given = {name for mark in marks for name in _parametrized(mark)}
            arguments = [*function.args.args, *function.args.kwonlyargs]
            optional = len(function.args.defaults)
            asked = {a.arg for a in arguments[: len(arguments) - optional]} - {"self"}
            place = f"{module.path.name}:{function.lineno}: {function.name}"
            for name in sorted(given - {a.arg for a in arguments}):
                yield f"{place} uses no argument {name}"
            for name in sorted(asked - given - fixtures):
                yield f"{place}: there is no fixture {name}"

    def _fixtures(self, module: Module) -> frozenset[str]:
        """Give the fixtures that the tests of a module can have."""
        parts = module.name.split(".")[:-1]
        above = (".".join([*parts[:k], "conftest"]) for k in range(1, len(parts) + 1))
        found: set[str] = set()
        for other in (module, *(self.modules[n] for n in above if n in self.modules)):
            found |= {f.name for f in other.functions if _is_fixture(f)}
            for node in other.imports:
                if isinstance(node, ast.ImportFrom):
                    found |= {alias.asname or alias.name for alias in node.names}
        return frozenset(found)


def _dotted(node: ast.AST) -> str:
    return ast.unparse(node) if isinstance(node, ast.Attribute | ast.Name) else ""


def _is_fixture(function: ast.FunctionDef) -> bool:
    marks: list[Any] = function.decorator_list
    names = [_dotted(m.func if isinstance(m, ast.Call) else m) for m in marks]
    return any(name.split(".")[-1] == "fixture" for name in names)


def _parametrized(mark: ast.Call) -> list[str]:
    """Give the names of `pytest.mark.parametrize`, where they are written out."""
    if _dotted(mark.func) != "pytest.mark.parametrize" or not mark.args:
        return []
    match mark.args[0]:
        case ast.Constant(value=str(text)):
            return [name.strip() for name in text.split(",")]
        case ast.Tuple(elts=names) | ast.List(elts=names):
            return [n.value for n in names if isinstance(n, ast.Constant)]
    return []
