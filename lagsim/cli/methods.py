"""`lagsim methods`: the methods, their orders and what each can handle."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lagsim.cli._shared import AsJson, faults_shown, show_json
from lagsim.errors import InputError, Problem
from lagsim.methods import method, names

if TYPE_CHECKING:
    from types import ModuleType


def command(
    name: Annotated[str | None, typer.Argument(help="Show the page on one.")] = None,
    as_json: AsJson = False,
) -> int:
    """List the integration methods, or show the page on one."""
    with faults_shown(as_json=as_json) as code:
        _check(name)
        chosen = [method(n) for n in (names() if name is None else (name,))]
        if as_json:
            show_json([_document(m) for m in chosen])
        elif name is None:
            print(_list(chosen))
        else:
            print(_page(chosen[0]))
        code.append(0)
    return code[-1]


def _check(name: str | None) -> None:
    if name is not None and name not in names():
        text = f"there is no method `{name}`"
        hint = f"one of {', '.join(names())}"
        raise InputError([Problem("unknown-method", text, hint=hint)])


def _document(module: ModuleType) -> dict[str, Any]:
    return {
        "name": module.NAME,
        "title": module.TITLE,
        "order": module.ORDER,
        "dense_order": module.DENSE_ORDER,
        "adaptive": module.ADAPTIVE,
        "imaginary_limit": module.IMAGINARY_LIMIT,
        "handles": module.HANDLES,
        "page": inspect.cleandoc(module.__doc__ or ""),
    }


def _list(modules: list[ModuleType]) -> str:
    lines = [f"{'name':<12}{'order':>5}  {'step':<9}handles"]
    for m in modules:
        step = "adaptive" if m.ADAPTIVE else "fixed"
        lines.append(f"{m.NAME:<12}{m.ORDER:>5}  {step:<9}{m.HANDLES}")
    return "\n".join(lines)


def _page(module: ModuleType) -> str:
    step = "adaptive step" if module.ADAPTIVE else "fixed step"
    facts = (
        f"order {module.ORDER}, dense output of order {module.DENSE_ORDER}, {step}; "
        f"handles {module.HANDLES}"
    )
    return f"{inspect.cleandoc(module.__doc__ or '')}\n\n{facts}"
