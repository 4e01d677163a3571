"""`lagsim methods`: the methods, their orders and what each can handle."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lagsim.cli._faults import faults_shown
from lagsim.cli._shared import AsJson, show_json
from lagsim.cli._streams import say
from lagsim.errors import InputError
from lagsim.methods import WIDTH, method, method_problems, names, page

if TYPE_CHECKING:
    from types import ModuleType


def command(
    name: Annotated[
        str | None, typer.Argument(help="Show the page on one.", autocompletion=names)
    ] = None,
    as_json: AsJson = False,
) -> int:
    """List the integration methods, or show the page on one."""
    documents: list[Any] = []
    with faults_shown(documents if as_json else None) as code:
        if name is not None and (problems := method_problems(name, auto=False)):
            raise InputError(problems)
        chosen = [method(n) for n in (names() if name is None else (name,))]
        if as_json:
            documents.append([_document(m) for m in chosen])
        else:
            say(_list(chosen) if name is None else _page(chosen[0]))
        code.append(0)
    if as_json:
        show_json(documents[0])
    return code[-1]


def _document(module: ModuleType) -> dict[str, Any]:
    return {
        "name": module.NAME,
        "title": module.TITLE,
        "order": module.ORDER,
        "dense_order": module.DENSE_ORDER,
        "adaptive": module.ADAPTIVE,
        "imaginary_limit": module.IMAGINARY_LIMIT,
        "handles": module.HANDLES,
        "page": page(module.NAME),
    }


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
    return f"{page(module.NAME)}\n\n{textwrap.fill(facts, WIDTH)}"
