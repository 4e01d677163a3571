"""Looking at a start."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lagsim.errors import LagsimError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from lagsim.api.models import Model


class Examination:
    """What there is to say of a start: the keys of `check --json` are attributes.

    Attributes
    ----------
    record : dict
        All of them.
    """

    admissible: bool
    degrees_of_freedom: int
    repair: dict[str, float] | None

    def __init__(self, record: Mapping[str, Any]) -> None:
        self.record = dict(record)

    def __getattr__(self, name: str) -> Any:
        record: dict[str, Any] = self.__dict__.get("record", {})
        if name not in record:
            raise AttributeError(f"an examination has no entry `{name}`")
        return record[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.record]

    def __repr__(self) -> str:
        return f"<Examination of {self.record['model']['name']}: {self._verdict()}>"

    def _verdict(self) -> str:
        from lagsim.outputs.notebook import counted

        word = "admissible" if self.admissible else "not admissible"
        return f"{word}, {counted(self.degrees_of_freedom, 'degree of freedom')}"

    def _repr_html_(self) -> str:
        from lagsim.outputs.notebook import heading, table

        parts = [heading(f"{self.record['model']['name']}: {self._verdict()}")]
        rows = [
            (c["name"], c["mode"] or c["kind"], f"{c['residual']:.3g}",
             "yes" if c["satisfied"] else "no")
            for c in self.record["constraints"]
        ]  # fmt: skip
        if rows:
            parts.append(table(rows, ("constraint", "kind", "residual", "satisfied")))
        if self.repair:
            values = [(name, f"{x!r}") for name, x in self.repair.items()]
            parts.append(table(values, ("the nearest start", "")))
        notes = [(w["code"], w["text"]) for w in self.record["warnings"]]
        parts += [table(notes, ("warning", ""))] if notes else []
        return "\n".join(parts)


class InadmissibleError(LagsimError):
    """No run begins at this start; `examination` says why, and what would do."""

    exit_code = 1
    code = "inadmissible"

    def __init__(self, text: str, examination: Examination) -> None:
        super().__init__(text)
        self.examination = examination


def check(model: Model | str | Path) -> Examination:
    """Tell whether the start of a model is admissible, and what its constraints are.

    Parameters
    ----------
    model
        What `load` gives, a path, or the text of a model file.

    Raises
    ------
    InputError
        Where the model has faults, or asks for a method or a formulation that cannot be
        had.
    """
    from lagsim.api.models import model_of
    from lagsim.outputs.examined import document
    from lagsim.run.session import check

    case, choices = check(model_of(model))
    return Examination(document(case.equations, case.examined, choices))
