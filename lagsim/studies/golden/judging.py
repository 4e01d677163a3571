"""A model's motion held against its golden."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lagsim.methods import method as method_named
from lagsim.outputs.manifest import versions
from lagsim.studies.comparison.judging import Deviation, deviations, ordered
from lagsim.studies.golden.invariants import invariants
from lagsim.studies.golden.measuring import SAME_TIME
from lagsim.studies.golden.motion import Motion, motion_of, paired
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any

    from lagsim.errors import Place
    from lagsim.language.arrays import Floats
    from lagsim.model.model import Model
    from lagsim.run.session import Case
    from lagsim.studies.golden.measuring import Golden
    from lagsim.studies.golden.storing import Stored

# What an invariant is called beside the column of its name.
CONSTANT = " (constant)"


@dataclass(frozen=True, slots=True)
class Judgement:
    """What was found.

    Attributes
    ----------
    worst : tuple of Deviation
        One for each column and invariant, the worst first.
    missing, extra : tuple of str
        Columns that are no longer there, or are new.
    faults, notes : tuple of str
        What else fails the run, and what is no failure.
    changed : tuple of str
        Parameters and start values that are no longer those of the golden.
    place : Place, optional
        The line of the file that made the difference, as far as it is known.
    """

    worst: tuple[Deviation, ...]
    missing: tuple[str, ...]
    extra: tuple[str, ...]
    faults: tuple[str, ...]
    notes: tuple[str, ...]
    changed: tuple[str, ...] = ()
    place: Place | None = None

    @property
    def passed(self) -> bool:
        """Whether the motion is still the same."""
        return not (self.missing or self.faults) and all(d.passed for d in self.worst)


def run(case: Case, stored: Stored) -> Motion:
    """Run a model so that its rows lie at the golden's times."""
    spacing = float(stored.about["output_step"])
    plan = case.plan()
    step = None if method_named(plan.method).ADAPTIVE else plan.step
    other = case.asking(output_step=spacing, step=step)
    return motion_of(other, stored.golden.stride)


def judge(case: Case, motion: Motion, stored: Stored) -> Judgement:
    """Hold a motion against the golden of its model."""
    golden, about = stored.golden, stored.about
    found = _columns(motion, stored)
    found += _invariants(case, motion, golden)
    missing = tuple(c for c in golden.columns if c not in motion.columns)
    known = about.get("columns", golden.columns)
    changed, places = _changed(case.equations.model, about)
    notes = _notes(case, motion, about, changed)
    worst = ordered(found)
    return Judgement(
        worst=worst,
        missing=missing,
        extra=tuple(c for c in motion.columns if c not in known),
        faults=tuple(_faults(motion, about)),
        notes=tuple(notes),
        changed=tuple(changed or ()),
        place=next(iter([*places, *_about(case.equations.model, worst)]), None),
    )


def _changed(
    model: Model, about: Mapping[str, Any]
) -> tuple[list[str] | None, list[Place]]:
    """Give what is no longer as it was, None where the golden does not tell, and where.

    Start values that follow a parameter are not named beside it.
    """
    found: list[str] | None = None
    places: list[Place] = []
    known = {"parameter": model.places, "start value": {}}
    known["start value"] = {x.name: x.place for x in model.initial}
    texts = model.stated.texts()
    known["expression"] = {name: x.place for name, x in texts.items()}
    now: dict[str, dict[str, Any]] = {
        "parameters": {p.name: p.value for p in model.parameters},
        "initial": {x.name: x.value for x in model.initial},
        "expressions": {name: x.text for name, x in texts.items()},
    }
    for (key, values), (word, where) in zip(now.items(), known.items(), strict=True):
        was = about.get(key)
        if not isinstance(was, dict) or (found and key == "initial"):
            continue
        found = found or []
        for name in [n for n in values if values[n] != was.get(n)]:
            other = f"in the golden {was[name]!r}" if name in was else "and is new"
            found.append(f"{word} `{name}` is {values[name]!r}, {other}")
            places += [where[name]] if name in where else []
        found += [f"{word} `{n}` is no longer there" for n in was if n not in values]
    return found, places


def _about(model: Model, worst: Sequence[Deviation]) -> list[Place]:
    """Give the places of what the columns that differ are named after."""
    places = dict(model.places)
    places |= {c.name: c.relation.place for c in model.constraints}
    found = []
    for deviation in worst:
        if not deviation.passed:
            base = deviation.column.removesuffix(CONSTANT)
            for prefix in ("Qc_", "lambda_", "residual_", "reaction."):
                base = base.removeprefix(prefix)
            for name in (base, base.removesuffix("_dot"), base.removesuffix("_ddot")):
                found += [places[name]] if name in places else []
    return found


def aligned(motion: Motion, stored: Stored) -> Floats:
    """Give the rows (k, columns) of a motion that belong to those of a golden."""
    golden = stored.golden
    near = SAME_TIME * float(stored.about["output_step"])
    return motion.at(golden.rows[:, 0], near, ends=golden.horizon is None)


def _columns(motion: Motion, stored: Stored) -> list[Deviation]:
    golden, rows = stored.golden, aligned(motion, stored)
    t = golden.rows[:, 0]
    near = SAME_TIME * float(stored.about["output_step"])
    found = []
    for k, name in enumerate(golden.columns):
        if name in motion.columns:
            new = rows[:, motion.columns.index(name)]
            bounds = golden.bounds(name)
            if name == "t":  # the same times as far as they were looked for
                bounds = bounds + np.where(paired(t), 0.0, near)
            found.append(deviations(name, t, golden.rows[:, k], new, bounds))
    return found


def _invariants(case: Case, motion: Motion, golden: Golden) -> list[Deviation]:
    now = invariants(case.equations, motion)
    found = []
    for name, kept in golden.invariants.items():
        values = now.get(name)
        if values is not None:
            value, bound = (np.full(len(values), x) for x in (kept.value, kept.bound))
            label = f"{name}{CONSTANT}"
            found.append(deviations(label, motion.rows[:, 0], value, values, bound))
    return found


def _faults(motion: Motion, about: Mapping[str, Any]) -> list[str]:
    outcome = motion.trajectory.outcome
    if not outcome.complete:
        return [f"the run does not finish: {motion.trajectory.reason}"]
    if outcome.word != about.get("outcome", outcome.word):
        was = about["outcome"]
        return [f"the run ends by `{outcome.word}`, the golden by `{was}`"]
    return []


def _notes(
    case: Case, motion: Motion, about: Mapping[str, Any], changed: list[str] | None
) -> list[str]:
    """Tell what has changed besides the motion."""
    notes = []
    model = case.equations.model
    if model.sha256 != about.get("model_sha256"):
        text = "the model file has changed since its golden was stored"
        if changed is not None:
            what = "; ".join(changed) or "not in what the golden holds of it"
            text = f"{text}: {what}"
        notes.append(text)
    for what in ("method", "formulation"):
        now, was = getattr(motion.plan, what), about.get(what)
        if now != was:
            notes.append(f"{what} {now}, the golden's is {was}")
    was, now = about.get("versions", {}), versions()
    changed = [f"lagsim {about.get('lagsim')}"] * (about.get("lagsim") != __version__)
    changed += [f"{k} {was[k]}" for k in now if k in was and was[k] != now[k]]
    if changed:
        notes.append(f"the golden is from {', '.join(changed)}")
    if case.settings.output_step != float(about["output_step"]):
        notes.append(f"rows every {about['output_step']!r}, as in the golden")
    end = float(about["end"])
    apart = abs(motion.trajectory.end - end)
    if apart > SAME_TIME * float(about["output_step"]):
        notes.append(
            f"the run ends at t = {motion.trajectory.end!r}, the golden's at {end!r}"
        )
    return notes
