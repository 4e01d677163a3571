"""What the rows of a run show: constraints, energy, and how far they can be trusted."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.evaluate import UNIT_ROUNDOFF, evaluate
from lagsim.mechanics.laws import Kind
from lagsim.methods import method
from lagsim.notes import Caution
from lagsim.run.error import Failed
from lagsim.run.observers.witness import gained as grown
from lagsim.run.trajectory import Outcome
from lagsim.studies.alarms.groups import account_of, worth
from lagsim.studies.error_bar import beside

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.instant import Instant
    from lagsim.model.model import Settings
    from lagsim.plan.plan import Plan
    from lagsim.run.error import ErrorBar
    from lagsim.run.observers.ledger import Ledger
    from lagsim.run.observers.witness import Witness
    from lagsim.run.trajectory import Trajectory
    from lagsim.studies.alarms.groups import Balance, Whole

# Rows meet the constraints to rounding; what is off by more than this part is not met.
HELD = 1e-6
# An unexplained change of the energy counts from this part of the energy in play on: an
# amplitude off by half of it is about the width of a line in a picture, and what the
# default tolerance leaves is a million times less.
UNEXPLAINED = 1e-3
# By far: so many times what the errors of the state explain, to first order and with
# all of them in the worst direction.
FAR = 100.0
# A drift is named from this part on; the default tolerance leaves 1e-9.
DRIFTED = 1e-6
# A contact is seen up to one step late, and stopped within the next; what a step leaves
# of other constraints is taken back in the next.
LATE = 2.0
# Within this part of a run before its end a row shows what has ended it.
AT_END = 1e-6
# And so many tolerances: steps leave 20 in the shipped models.
MANY = 1e3
# Of what is rounded in the energy of a row, in two rows.
BOTH = 4.0
# What moves this many times farther than the rounding of forces takes it moves.
HIGHER = 16.0
# A place is known no better than to this part of the motion beside it.
NEIGHBOURS = 1e-12


def _unknown(why: str, drift: str) -> list[Caution]:
    """Say that no error is known, if a repeat failed or the energy has drifted."""
    if not drift and not isinstance(why, Failed):
        return []
    text = f"the error of the rows is not known: {why}"
    if drift:
        text += f"; {drift}"
    return [Caution("error-unknown", text)]


def _drift(
    equations: Equations,
    plan: Plan,
    each: Iterable[Balance | Whole],
    witness: Witness,
) -> str:
    """Say by how much an energy drifts that the tolerance should keep, or give "".

    By a method that chooses its steps, or makes no error of its own. What is more than
    `UNEXPLAINED` has a warning of its own.
    """
    if plan.rtol is None and math.isfinite(method(plan.method).ORDER):
        return ""
    least = max(DRIFTED, MANY * (plan.rtol or 0.0))
    for account in sorted(each, key=_part, reverse=True):
        part = _part(account)
        if not part > least:
            break
        row = account.worst_row
        if part > UNEXPLAINED or row is None:
            continue
        from lagsim.studies.alarms.jumps import jumps

        state = UNIT_ROUNDOFF * np.abs(row[1 : 1 + 2 * len(equations.q)])
        rounded = BOTH * worth(equations, account.energy, row, state)
        _, still = held_still(equations, witness, account.coordinates)
        since = account.since(max(least * account.in_play, rounded, still))
        if since is not None and not jumps(equations, account):
            of = f"{account_of(account)} is off by {part:.2g} of the energy in play"
            return f"{of} from t = {since:.6g} on"
    return ""


def _part(account: Balance | Whole) -> float:
    """Give by what part of the energy in play an account is off."""
    return account.drift / (account.in_play or 1.0)


def about_error(
    bar: ErrorBar | str,
    equations: Equations,
    plan: Plan,
    each: Iterable[Balance | Whole],
    witness: Witness,
) -> list[Caution]:
    """Say from when on the rows are no forecast, and whether their end is one.

    And where their energy is off by more than the tolerance leaves, whatever the
    estimated error says of it. each : the accounts of that.
    """
    drift = _drift(equations, plan, each, witness)
    if isinstance(bar, str):
        return _unknown(bar, drift)
    found = []
    if bar.parted:
        text = f"{bar.parted}: it is not known which is right"
        found.append(Caution("end-in-doubt", f"how the run ends is uncertain: {text}"))
    if bar.horizon is not None:
        less = "a shorter step" if plan.rtol is None else "a tighter rtol"
        text = (
            f"past t = {bar.horizon:.6g} the estimated error exceeds a tenth of a "
            "coordinate's range: later rows show one possible motion of many "
            f"({less} moves this time)"
        )
        found.append(Caution("horizon", text))
    if drift and plan.atol is None:
        text = (
            f"{drift}, more than the tolerance allows: the error of the rows is "
            f"about {bar.relative:.2g} of a coordinate's range (far from the "
            "origin, positions have few digits left for small motions)"
        )
        found.append(Caution("energy-drifts", text))
    return found


def about_constraints(
    equations: Equations,
    start: Instant,
    plan: Plan,
    ledger: Ledger,
    witness: Witness,
    trajectory: Trajectory,
) -> list[Caution]:
    """Say so where rows do not meet the constraints: the motion is then no answer.

    A method that locates no impact leaves a contact as deep as the motion goes in its
    steps, and other constraints off by what they change in these: it promises no more.
    """
    coarse = None
    if plan.step is not None and not getattr(method(plan.method), "EVENTS", True):
        extents = trajectory.extents
        speeds = [max(map(abs, extents.get(v, (0.0,)))) for v in equations.velocities]
        coarse = LATE * plan.step, np.array(speeds)
    found = not_held(equations, start, ledger, witness, coarse)
    if found is None:
        return []
    name, worst = found
    if trajectory.outcome is Outcome.CONSTRAINT_JUMPS:
        since = ledger.constraint_since(name, HELD)
        length = trajectory.end - trajectory.start
        if since is not None and trajectory.end - since <= AT_END * length:
            return []  # the last row shows the jump that has ended the run
    why = "the constraints do not determine this motion, and the rows are not valid"
    if not plan.projected and not plan.reduction.eliminated:
        why = (
            f"the formulation {plan.formulation} does not enforce it; `projection` does"
        )
    text = (
        f"constraint `{name}` is not satisfied in all rows (off by {worst:.2g} of "
        f"its scale): {why}"
    )
    return [Caution("constraint-not-held", text)]


def not_held(
    equations: Equations,
    start: Instant,
    ledger: Ledger,
    witness: Witness,
    coarse: tuple[float, Floats] | None = None,
) -> tuple[str, float] | None:
    """Give the constraint that is off most, and the part of its scale; or None.

    coarse : the time for which a row may be as it was, and the largest speeds (n,).

    Where all of its terms all but vanish they are no scale: what counts is by how much
    of their motion the coordinates would have to move to meet it.
    """
    n = len(equations.q)
    g = equations.graph
    contacts = {x.constraint for x in equations.laws if x.kind is Kind.CONTACT}
    for name, residual, part, values in ledger.constraints_off(HELD):
        if not math.isfinite(residual):
            return name, part
        row = equations.row(name)
        moved = witness.ranges[1 : 1 + n]
        seed = NEIGHBOURS * beside(equations, start, moved)
        if not row.holonomic:
            moved = witness.ranges[1 + n : 1 + 2 * n]
            seed = NEIGHBOURS * beside(equations, start, moved)
        state = dict(zip(equations.q, values[1 : 1 + n].tolist(), strict=True))
        rates = values[1 + n : 1 + 2 * n].tolist()
        state |= dict(zip(equations.velocities, rates, strict=True))
        state |= {p.name: p.value for p in equations.model.parameters}
        state["t"] = float(values[0])
        slopes = np.abs(evaluate(g, list(row.A), state))
        if coarse is not None:
            left = _changed(equations, row, state, values, coarse[0])
            if name in contacts:
                still = state | dict.fromkeys(equations.velocities, 0.0)
                (moving,) = evaluate(g, [row.rate], still)
                left = coarse[0] * (float(slopes @ coarse[1]) + abs(moving))
            if residual <= left:
                continue
        seed = seed + held_still(equations, witness, range(n))[0]
        if residual > HELD * float(slopes @ moved) + float(slopes @ seed):
            return name, part
    return None


def _changed(
    equations: Equations, row: Row, state: Mapping[str, float], values: Floats, h: float
) -> float:
    """Give by how much a constraint may be off at a row of a step that begins h before.

    Its rate is met with positions and time of half a step before, and linearised.
    """
    g, n = equations.graph, len(equations.q)
    q, v, a = values[1 : 1 + 3 * n].reshape(3, n)

    def rate(ago: float, more: float) -> float:
        x = {**state, "t": state["t"] - ago}
        x |= zip(equations.q, (q - ago * v).tolist(), strict=True)
        x |= zip(equations.velocities, (v + more * a).tolist(), strict=True)
        return float(evaluate(g, [row.rate], x)[0])

    now = rate(0.0, 0.0)
    off = max(abs(rate(part * h, 0.0) - now) for part in (0.25, 0.5, 1.0))
    off += abs(rate(0.0, h) - 2.0 * now + rate(0.0, -h))
    return h * (abs(now) + off) if row.holonomic else off


def held_still(
    equations: Equations, witness: Witness, which: Sequence[int]
) -> tuple[Floats, float]:
    """Give how far (n,) rounding moves what is held, or balanced, and its energy.

    Of the coordinates of these numbers. What forces leave of it, where they
    balance, makes a motion of its own, with nothing beside it to compare it with where
    all else rests. What moves farther has no part in it.
    """
    from lagsim.run.held import could_push

    n = len(equations.q)
    rows, span = witness.passed, float(witness.ranges[0])
    found = could_push(equations, rows, which, span, witness.held)
    rests = witness.ranges[1 : 1 + n] <= HIGHER * found.moved
    moved = np.where(rests, found.moved, 0.0)
    return moved, float(moved @ found.forces)


def rounding(equations: Equations, account: Balance | Whole, witness: Witness) -> float:
    """Give what the rounding of the worst row is worth in the energy of an account."""
    row, own = account.worst_row, account.coordinates
    if row is None:
        return 0.0
    state = np.abs(row[1 : 1 + 2 * len(equations.q)])
    far = FAR * worth(equations, account.energy, row, UNIT_ROUNDOFF * state)
    return max(far, held_still(equations, witness, own)[1])


def about_energy(
    equations: Equations,
    settings: Settings,
    plan: Plan,
    trajectory: Trajectory,
    each: Sequence[Balance | Whole],
    witness: Witness,
) -> list[Caution]:
    """Say so where the energy drifts and no force explains it.

    Of each group of bodies that touches no other, or of the whole. The energy of a
    symplectic method swings to and fro, and goes nowhere: of a fixed step, what is
    gained on the whole counts, else the largest deviation.
    """
    found: list[Caution] = []
    for account in each:
        if account.names or not found:
            found += _gained(equations, settings, plan, trajectory, account, witness)
    return found


def _gained(
    equations: Equations,
    settings: Settings,
    plan: Plan,
    trajectory: Trajectory,
    account: Balance | Whole,
    witness: Witness,
) -> list[Caution]:
    in_play = account.in_play
    gained = account.gained(farthest=plan.rtol is not None)
    if not abs(gained) > UNEXPLAINED * in_play:
        return []
    if abs(gained) <= rounding(equations, account, witness):
        return []
    from lagsim.studies.alarms.jumps import besides_jumps

    since = account.since(UNEXPLAINED * in_play)
    rest = besides_jumps(equations, account)
    if rest is not None:
        drifts = rest - rest[0]
        gained = grown(rest)
        if plan.rtol is not None:
            gained = float(drifts[np.argmax(np.abs(drifts))])
        if not abs(gained) > UNEXPLAINED * in_play:
            return []
        off = np.abs(drifts) > UNEXPLAINED * in_play
        since = float(account.rows[np.argmax(off), 0])
    when = witness.end if plan.rtol is None or since is None else since
    way = "gained" if gained > 0.0 else "lost"
    part = abs(gained) / in_play
    reached = "by" if plan.rtol is None else "from"
    of = f" of {', '.join(account.names)}" if account.names else ""
    text = (
        f"the motion{of} has {way} energy that no force explains, {part:.2g} of the "
        f"energy in play {reached} t = {when:.6g}"
    )
    if rest is not None:
        text += ", besides jumps of its expression, which are no error"
    elif trajectory.outcome.complete:
        text += f": that is an error of {_whose(plan)}; {_how(settings, plan)} it"
    return [Caution(f"energy-{way}", text)]


def _whose(plan: Plan) -> str:
    """Name what lets the energy go."""
    if plan.formulation == "drift":
        return f"{plan.method} and of the formulation drift"
    return plan.method


def _how(settings: Settings, plan: Plan) -> str:
    """Say what keeps the energy: nothing that has been tried."""
    how = "a shorter step" if plan.rtol is None else "a tighter rtol"
    if settings.method != "auto":
        return f"{how}, or `--method auto`, keeps"
    return f"{how} keeps"
