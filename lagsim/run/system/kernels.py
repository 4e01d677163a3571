"""The object code of what a method calls besides the model's functions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lagsim.native.link.cache import kernel_object

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from lagsim.run.system.runner import Compiled


def kernels(system: Compiled) -> Iterator[bytes]:
    """Give the object code of what a method calls besides the model's functions."""
    if system.met is not None:
        from lagsim.methods import moreau as impulses

        yield kernel_object([impulses.observe])
    elif system.laws:
        yield _laws()
    elif system.plan.elimination is None:
        yield _loops(system.m > 0, system.surfaces > 0)
    if system.has_jacobian:
        from lagsim.solve.jacobian import jacobian

        yield kernel_object([jacobian])
    if system.watched:
        from lagsim.solve import sliding

        kernels: list[Callable[..., Any]] = [sliding.derivative, sliding.observe]
        kernels += [sliding.margins, sliding.pull]
        yield kernel_object(kernels, {"LAWS": bool(system.laws)})


def _laws() -> bytes:
    """Give the object code of the solve with laws."""
    from lagsim.solve import laws

    return kernel_object(
        [
            laws.field, laws.rounding, laws.position_step, laws.velocity_step,
            laws.law_margins,
        ]
    )  # fmt: skip


def _loops(constrained: bool, switching: bool) -> bytes:
    """Give the object code of the solve by loops."""
    from lagsim.solve import dense

    kernels: list[Callable[..., Any]] = [dense.derivative, dense.observe]
    if switching:
        kernels = [dense.field]
    kernels.append(dense.rounding)
    if constrained:
        kernels += [dense.position_step, dense.velocity_step]
    return kernel_object(kernels)
