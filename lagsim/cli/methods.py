"""`lagsim methods`: the methods, their orders and what each can handle."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import typer

from lagsim.cli._shared import JSON, print_stdout, show_json
from lagsim.errors import InputError
from lagsim.methods import WIDTH, method, method_page, method_problems, names

if TYPE_CHECKING:
    from types import ModuleType


def command(
    name: str | None = typer.Argument(
        None, help="Show the page on one.", autocompletion=names
    ),
    as_json: bool = JSON,
) -> int:
    """List the integration methods, or show the page on one."""
    if name is not None and (problems := method_problems(name, auto=False)):
        raise InputError(problems)
    chosen = [method(n) for n in (names() if name is None else (name,))]
    if as_json:
        show_json([_document(m) for m in chosen])
    else:
        print_stdout(_list(chosen) if name is None else _page(chosen[0]))
    return 0


def _document(module: ModuleType) -> dict[str, Any]:
    facts = (
        "name", "title", "order", "dense_order", "adaptive", "imaginary_limit",
        "handles",
    )  # fmt: skip
    found = {key: getattr(module, key.upper()) for key in facts}
    return found | {"page": method_page(module.NAME)}


def _list(modules: list[ModuleType]) -> str:
    wide = max(len(m.NAME) for m in modules) + 2
    lines = [f"{'name':<{wide}}{'order':>5}  {'step':<10}handles"]
    for m in modules:
        step = "adaptive" if m.ADAPTIVE else "fixed"
        lines.append(f"{m.NAME:<{wide}}{m.ORDER:>5}  {step:<10}{m.HANDLES}")
    return "\n".join(lines)


def _page(module: ModuleType) -> str:
    step = "adaptive step" if module.ADAPTIVE else "fixed step"
    facts = (
        f"Order {module.ORDER}, dense output of order {module.DENSE_ORDER}, {step}. "
        f"Handles {module.HANDLES}."
    )
    return f"{method_page(module.NAME)}\n\n{textwrap.fill(facts, WIDTH)}"
