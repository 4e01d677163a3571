"""Switches in the state: the modes of surfaces, and the accumulation of switches.

At an instant the state is below, above or on each surface. On a surface, the
rate of its expression selects the side. Where this rate vanishes or depends on the
side, Filippov's conditions select the mode (`crossing`): the motion leaves to a side or
slides along the surface.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.codes.known import UNRESOLVED_SWITCH
from lagsim.language.tables import is_smooth
from lagsim.mechanics.algebra import multiple_of
from lagsim.methods.parts import parameters as kept
from lagsim.methods.parts import state as at
from lagsim.notes import Event
from lagsim.run.arc import NEAR, SERIES, largest_shift, shift
from lagsim.run.events.accumulation import REGULAR, Accumulation
from lagsim.run.events.corner_sides import CornerSides, JumpPiece
from lagsim.run.events.crossing import Crossing
from lagsim.run.events.curve_ends import REACH, come_to_rest
from lagsim.run.events.root_floors import set_floors
from lagsim.run.events.surface_modes import LEVEL, SLIDING, SurfaceModes
from lagsim.run.failures import FAILED, handed_over
from lagsim.run.trajectory import (
    GO_ON,
    Decision,
    Ending,
    Located,
    Outcome,
    Source,
    Turn,
    quoted,
)
from lagsim.tolerances import (
    CLEAR_OF_ROUNDING,
    RESIDUAL_ROUNDOFF,
    SOLUTION_ROUNDOFF,
    STATE_ROUNDOFF,
    TIME_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from lagsim.language.arrays import Flags, Floats
    from lagsim.notes import Caution
    from lagsim.run.arc import Arc
    from lagsim.run.events.records import LawsAt, SurfacesAt

# Error of a nearly constant coordinate, in units of rtol times its largest change in a
# step.
NOISE = 1e-4
# A passage of a corner is short where it goes no farther than this many roundings.
SHORT = 16.0
# Velocities left at the limit of accumulating switches, relative to earlier ones.
LEFT = 1e-4
# Factor of the distance to a surface that was reached: the distance is known no better.
TWICE = 2.0
# Allowance for the rounding of a constant expression, in parts of sampled values.
LARGER = 8.0
BENT = (
    "{} makes no progress near a switch: its steps are shorter than the rounding of "
    "positions allows"
)


class SidesFound(NamedTuple):
    """The modes of all surfaces that were selected at an instant.

    Attributes
    ----------
    decision : Decision
        The state on the surfaces followed, with the events and warnings.
    surfaces : SurfacesAt
        The surfaces at the instant, with the levels and modes found.
    laws : LawsAt or None
        The laws, with the modes that were selected together with sides.
    """

    decision: Decision
    surfaces: SurfacesAt
    laws: LawsAt | None


class Switching(Source):
    """The source of the switches of a run that depend on its state.

    Attributes
    ----------
    modes : SurfaceModes
        The modes of all surfaces in the present arc.
    sequence : Accumulation
        The last switches, by which accumulations are found.
    resting : dict of int to float
        Surfaces at whose level constraints hold the motion in the present arc, see
        `surface_modes.SurfaceModes.constrained`.
    passed_at : float
        The time of the last point of a table that the kernel has passed.
    kept : list of int
        The surfaces at whose levels the motion stays by itself, by the last selection.
    at_rest : list of int
        The surfaces at whose levels the motion is at rest while it could also follow
        them, by the last selection.
    """

    def __init__(self, arc: Arc) -> None:
        self.modes = SurfaceModes(arc)
        self.sides = self.modes.sides
        self.on_rates = self.modes.on_rates
        self.sequence = Accumulation(arc.settings.duration)
        g = arc.equations.graph
        self._smooth = [is_smooth(g, g.call("floor", s.node)) for s in self.sides]
        self.resting: dict[int, float] = {}
        self.passed_at = math.nan
        self.at_rest: list[int] = []
        self.kept: list[int] = []

    @property
    def slides(self) -> Flags:
        """Mask (K,) of the surfaces that the motion follows."""
        return self.modes.slides

    def pause_at(self, arc: Arc) -> int:
        """Return the step number at which approaches to surfaces are checked next.

        See `decide`.
        """
        return (arc.steps // NEAR + 1) * NEAR

    def passed(self, arc: Arc) -> Decision:
        """Return a decision with the events of the table points that the kernel passed.

        Points of a smooth table are events only where y' jumps.
        """
        state, p = arc.state, arc.system.p
        count = int(state.crossed)
        if not count:
            return GO_ON
        which, state.crossed = state.cross_surfaces[:count].astype(int), 0.0
        times, levels = state.cross_times[:count], state.cross_levels[:count]
        events = [
            Event(t, "switch", switch=self.sides[k].text)
            for t, k, x in zip(times.tolist(), which.tolist(), levels, strict=True)
            if not (self._smooth[k] and p.first_smooth[k] < x < p.last_smooth[k])
        ]
        self.passed_at = float(state.cross_times[count - 1])
        return Decision(events=tuple(events))

    def _reached(self, arc: Arc, k: int) -> Decision:
        """Return the decision to settle where surface k reaches its level.

        In the decision, `Located.off` is the distance of the switch's expression from
        its level up to which the surface counts as at its level: twice the present
        distance; 0 for a carried surface, whose expression jumps with the side of its
        leader. It is negative where the expression itself jumps past its level, as
        `tan` does at a pole: the side is then that of the value. The decision ends the
        run where the expression has no value.
        """
        modes, off = self.modes, 0.0
        if arc.state.discontinuous:
            off = -1.0
        elif arc.system.p.leader[k] == 0.0:  # a carried surface has another value above
            off = float(modes.off_levels()[k])
        if math.isnan(off):  # such as log(1 - x) past x = 1
            return Decision(ending=Ending(Outcome.NOT_FINITE))
        return Decision(turn=Turn.SETTLE, located=Located(surface=k, off=TWICE * off))

    def comes_to_rest(self, arc: Arc, surfaces: SurfacesAt) -> bool:
        """Whether forces may hold a rate at 0 from this instant on, at a switch.

        That is so if a surface that depends on velocities, such as that of
        `sign(x_dot)`, is at its level to rounding.

        surfaces : those at the instant, with the levels that the state is on.
        """
        modes = self.modes
        rates = modes.on_rates & ~modes.shown
        if not np.any(rates):
            return False
        modes.begin(arc)
        near = RESIDUAL_ROUNDOFF * modes.sizes()
        if surfaces.located >= 0:
            near[surfaces.located] = max(near[surfaces.located], surfaces.off)
        return bool(np.any(rates & (modes.off_levels() <= near)))

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Return the decision at a located switch, or beside one that no step can pass.

        None if the code of the kernel concerns no switch.
        """
        self.modes.begin(arc)
        if code == at.SWITCH_FOUND:
            hit = int(arc.state.switched) - 1
            return self._reached(arc, hit) if hit < arc.system.acting_surfaces else None
        if code in FAILED:
            return self._reached_to_rounding(arc)
        checks = code == at.PAUSED and arc.checks_approach
        return self._stuck(arc) if checks and arc.t != self.passed_at else None

    # The modes at an instant

    def put_on_levels(self, arc: Arc) -> None:
        """Put each surface that the state is on at its level, to rounding.

        All other surfaces are set to the sides of their expressions' values.
        """
        modes = self.modes
        modes.begin(arc)
        modes.forget()
        crossing = Crossing(modes, {}, (), 0.0, -1, (), None)
        crossing.find()
        for k, level in crossing.levels.items():
            modes.set_mode(k, level, LEVEL)
        modes.write()

    def select(
        self,
        arc: Arc,
        surfaces: SurfacesAt,
        laws: LawsAt | None,
        hit: int | None = None,
        *,
        at_rest: Collection[int] = (),
        time: float | None = None,
    ) -> SidesFound:
        """Select the modes of all surfaces at the state reached.

        Parameters
        ----------
        surfaces : SurfacesAt
            The surfaces at the instant, before the selection.
        laws : LawsAt or None
            The laws at the instant; None for a model without laws.
        hit
            The surface whose mode has just ended.
        at_rest
            Surfaces that the state is on, and whose expressions have the rate zero.
        time
            The time of the events returned, if not the time reached.
        """
        modes = self.modes
        modes.begin(arc)
        time = arc.t if time is None else time
        if surfaces.stopped:
            at_rest = {*at_rest, *surfaces.stopped}
        before, held = self.slides, self._held()
        modes.forget()
        set_floors(modes, hit, slipping=hit is not None and bool(before[hit]))
        known = self._known(surfaces) | dict.fromkeys(at_rest, math.inf)
        roundoff = np.zeros(modes.count)
        cautions: tuple[Caution, ...] = ()
        left = max(0.0, time - arc.t) if at_rest else 0.0
        crossing = Crossing(
            modes, known, at_rest, left, surfaces.located, self.resting, laws
        )
        modes.continued = True
        crossing.find()
        levels = crossing.levels
        rests = come_to_rest(modes, levels, crossing.sizes, left, laws)
        if not rests:
            crossing.decide()
            roundoff = crossing.roundoff
            cautions = self._undecided(crossing.undecided)
            # A corner that forces hold at its level, and could follow, is a groove.
            ridges = [k for k in corners_met(arc, levels) if k not in crossing.rests]
            ridges = [k for k in ridges if modes.kind[k] == kept.LEVEL]
            cautions += self._undecided(ridges)
            for k in crossing.undecided:
                if modes.kind[k] == 0.0:  # rows show the choice
                    modes.kind[k] = kept.CHOSEN
        self.at_rest, self.kept = crossing.rests, crossing.kept
        modes.continued = False
        modes.write()
        modes.store(roundoff=2.0 * roundoff, decisive=modes.decisive())
        self._set_slack(crossing)
        y = self._projected(resting=rests or bool(at_rest))
        found = Decision(
            y=y,
            events=tuple(self._changes(held, before, hit, time, rests=rests)),
            cautions=cautions,
            ending=None if y is not None else Ending(Outcome.STATE_JUMPS),
        )
        surfaces = surfaces._replace(levels=levels, selected=modes.selected())
        if laws is not None:
            laws = laws._replace(shared=crossing.shared)
        return SidesFound(found, surfaces, laws)

    # Corners of equalities

    def stop(
        self, arc: Arc, y: Floats, surfaces: SurfacesAt, off: Floats
    ) -> tuple[list[Event], frozenset[int]]:
        """Project velocities onto the equalities at corners, or stop them there.

        The projection uses the selected sides. If the projected velocities do not lead
        onto these sides, other sides are tried; if no sides are a solution, the
        velocities are stopped (`CornerSides`). Velocities are also stopped if forces
        reverse them before the position changes by more than rounding.

        Return the events of the corners at which forces stop the velocities, and all
        corners at which velocities are stopped.

        Parameters
        ----------
        arc
            The arc that begins.
        y : ndarray, shape (size,)
            The state, whose velocities are changed in place.
        surfaces : SurfacesAt
            The surfaces at the instant, with the sides selected.
        off : ndarray, shape (n,)
            The error of the velocities before, which is no part of the projection.
        """
        modes, found = self.modes, list[Event]()
        sides = CornerSides(arc, modes, surfaces)

        def jump(piece: JumpPiece) -> Floats:
            after = piece.y.copy()
            sides.project(after, piece.stopped)
            if piece.left == 1.0:
                after[arc.velocities] -= off
            return piece.y + piece.part * (after - piece.y)

        for after in sides.pieces(jump, selected=True):
            y[:] = after
        stopped = {*sides.stopped}
        sizes, magnitudes = modes.sizes(y), arc.magnitudes[arc.velocities]
        while True:
            rows = modes.rows(y)
            ways = np.array([modes.way(k, x) for k, x in enumerate(modes.levels)])
            speeds, back = ways * rows.rates, -ways * modes.forced(y)
            least = np.abs(rows.J[:, : arc.system.n]) @ magnitudes
            least *= CLEAR_OF_ROUNDING * RESIDUAL_ROUNDOFF
            short = speeds**2 <= SHORT * RESIDUAL_ROUNDOFF * sizes * back
            turns = arc.system.switches.turns.intersection(sides.corners)
            left = [k for k in turns if k not in {*stopped, *sides.off}]
            wrong = [k for k in left if short[k]]
            if not wrong:
                break
            end = self.sequence.end()
            time = arc.t if end is None else max(arc.t, end)
            rest = (k for k in wrong if speeds[k] > least[k])
            found += [self._rested(arc, k, time) for k in rest]
            for k in wrong:
                modes.set_mode(k, sides.corners[k], SLIDING)
            stopped.update(wrong)
            modes.write()
            self._put_on(y)
        return found, frozenset(stopped)

    def _put_on(self, y: Floats) -> None:
        """Project the state y (size,), in place, onto surfaces that the motion follows.

        Velocities are projected first onto the equality rows of the lower side, since
        they may satisfy the rows of the upper side before.
        """
        arc = self.modes.arc
        step = arc.runner.function("velocity_step")(arc.t, y)
        y[arc.velocities] += step[: arc.system.n]
        arc.runner.project_sliding(arc.t, y)

    def _projected(self, *, resting: bool) -> Floats | None:
        """Return the state (size,) projected onto the surfaces followed, or None.

        None where the projection changes the state too far.

        resting : whether the motion rests on surfaces, where a larger change is
            allowed.
        """
        arc, n = self.modes.arc, self.modes.arc.system.n
        former, y = arc.y, arc.y.copy()
        if resting and any(self.slides[k] for k in arc.system.switches.turns):
            self._put_on(y)
            arc.add_work(y, arc.energies(former))
        else:
            arc.runner.project_sliding(arc.t, y)
        masses = arc.runner.function("energies_masses")(arc.t, former)[2 : 2 + n]
        most = largest_shift(arc.plan.rtol)
        most = max(most, LEFT) if resting else most
        for part in (arc.state.positions, arc.velocities):
            change = y[part] - former[part]
            reach = self._reach(y)[part]
            far = shift(masses, change, reach, arc.magnitudes[part])
            if not far <= most:
                sizes = self.modes.sizes_along_rows()
                far = shift(masses, change, reach, sizes[part])
            if not far <= most:
                return None
        return y

    def _known(self, surfaces: SurfacesAt) -> dict[int, float]:
        """Return the surfaces that must be at their levels, each with a distance bound.

        A rounded value of such an expression may be off its level by up to that bound.

        The result contains the surface reached last, with its distance then (negative
        where its expression has jumped past its level, see `_reached`), and the
        surfaces at whose levels constraints hold the motion, with the rounding of the
        constraints. A surface whose expression has jumped since is farther off and not
        included.
        """
        modes, distances = self.modes, dict[int, float]()
        if self.resting:
            off = modes.off_levels()
            distances = {k: most for k, most in self.resting.items() if off[k] <= most}
        self.resting = modes.constrained()
        distances |= self.resting
        if self.kept:  # each step adds the rounding of positions
            off, sizes = modes.off_levels(), modes.sizes()
            most = (1 + self.modes.arc.steps) * STATE_ROUNDOFF * sizes
            distances |= {k: most[k] for k in self.kept if off[k] <= most[k]}
        if (k := surfaces.located) >= 0:
            jumps = surfaces.off < 0.0
            distances[k] = (
                surfaces.off if jumps else max(surfaces.off, distances.get(k, 0.0))
            )
        return distances

    def _undecided(self, several: list[int]) -> tuple[Caution, ...]:
        """Return a caution, given once, that the motion past surfaces is not unique.

        several : the indices of these surfaces; () is returned if there are none.
        """
        names = self._names(several)
        text = (
            f"at t = {self.modes.arc.t:.9g} the motion past the switch of {names} "
            "is not unique: one of several was selected"
        )
        return self.once(UNRESOLVED_SWITCH, text, names) if several else ()

    def _names(self, several: Collection[int]) -> str:
        return quoted(self.sides[k].text for k in sorted(several))

    def _set_slack(self, crossing: Crossing) -> None:
        """Set the tolerances of the event functions that end the modes of surfaces.

        These are `slack` and `band`, shape (K,): bounds of the roundoff of the event
        functions, and of their errors within the tolerance of the run.

        crossing : the selection of the modes.
        """
        levels, rows, sizes = crossing.levels, crossing.rows, crossing.sizes
        slides, modes, arc = self.slides, self.modes, self.modes.arc
        slack = np.where(modes.shown, modes.p.slack[: modes.count], 0.0)
        modes.store(slack=slack)
        event_functions = arc.runner.event_functions(arc.t, arc.y)
        for k in modes.carried:
            slack[k] = RESIDUAL_ROUNDOFF * sizes[k]
        for k in levels:
            # A surface at its level has a slack, see `methods.parts.leaving`.
            own = max(RESIDUAL_ROUNDOFF * sizes[k], math.ulp(0.0))
            least = SOLUTION_ROUNDOFF if slides[k] else own
            slack[k] = least + 2.0 * max(0.0, -event_functions[k])
        # A constant expression that is exactly at its level leaves it at any other
        # value; one that is at its level within rounding leaves it at a larger one.
        for k in modes.watched:
            if k in crossing.constant:
                sampled = modes.roundoff_around(k)
                if k != crossing.hit and event_functions[k] == sampled == 0.0:
                    slack[k] = 0.0
                slack[k] = max(slack[k], LARGER * sampled)
        followed = [*modes.watched, *modes.carried]
        if followed and arc.system.m:
            slack[followed] += modes.drifts()[followed]
        # Changes of the expressions by errors within the tolerance: where a coordinate
        # hardly moves their sign is arbitrary. The tolerance has a floor, see
        # `methods.parts.control`; within the floor of a surface its roots coincide.
        speeds = np.abs(rows.J) @ self._reach(arc.y)[arc.state.driven]
        step = arc.t - arc.state.step_t if arc.steps else 0.0
        noise = NOISE * arc.state.rtol * np.where(self.on_rates, speeds, step * speeds)
        roundoff = np.maximum(noise, 0.5 * modes.p.floor)
        modes.store(slack=slack, band=np.where(slides, 0.0, roundoff))

    def _reach(self, y: Floats) -> Floats:
        """Return the ranges (size,) so far, extended to the state y (size,).

        The changes of q and q' in a step by the terms of the forces are added.
        """
        arc, n = self.modes.arc, self.modes.arc.system.n
        pushes = arc.state.parts[:n]
        if arc.system.laws:
            pushes = np.maximum(pushes, arc.system.p.law_pushes[:n])
        # The step that ended at an event may be as short as rounding of the time.
        step = max(arc.t - arc.state.step_t, arc.state.step_h) if arc.steps else 0.0
        ranges, velocities = arc.ranges_to(y), arc.velocities
        ranges[velocities] += step * pushes
        ranges[arc.state.positions] += step * ranges[velocities]
        return ranges

    # Passing a switch

    def _held(self) -> Flags:
        """Mask (K,) of the surfaces on which the motion stays.

        It follows the surfaces or is at rest at their levels. The two count alike here,
        so that the events do not depend on the columns of the output, by which one of
        them is selected (`Crossing._select_rest`).
        """
        held = self.modes.holds
        held[self.at_rest] |= self.modes.kind[self.at_rest] == kept.LEVEL
        return held

    def _changes(
        self, before: Flags, slid: Flags, hit: int | None, time: float, *, rests: bool
    ) -> Iterator[Event]:
        """Yield the events of changed modes.

        before, slid : the surfaces (K,) on which the motion stayed, and those that it
            followed, before the selection.
        """
        holds = self._held()
        for k in np.flatnonzero(before != holds):
            kind = "switch"
            if self.on_rates[k] or rests:
                kind = "stick" if holds[k] else "slip"
            if holds[k] and kind == "switch" and self.sequence.ratio() < 1.0:
                kind = "zeno"  # rest before the extrapolated limit
            yield Event(time, kind, switch=self.sides[k].text)
        if hit is None:
            return
        if before[hit] == holds[hit] == self.slides[hit] == slid[hit]:
            yield Event(time, "switch", switch=self.sides[hit].text)

    def select_at(
        self, arc: Arc, surfaces: SurfacesAt, laws: LawsAt | None, k: int
    ) -> SidesFound:
        """Select the modes at surface k, which the motion has just reached.

        Where switches accumulate, the state counts as at rest on their surfaces.
        Arguments: see `select`.
        """
        self.sequence.add(arc.t, k)
        found = self._at_limit(arc, surfaces, laws, k)
        return found or self.select(arc, surfaces, laws, k)

    def _at_limit(
        self, arc: Arc, surfaces: SurfacesAt, laws: LawsAt | None, k: int
    ) -> SidesFound | None:
        """Select rest on the surfaces whose switches accumulate.

        Returns None if switches do not accumulate, if the rest of the motion up to
        their limit is not negligible, or if forces do not hold the motion on the
        surfaces. Arguments: see `select`.
        """
        limit = self.sequence.limit()
        if limit is None:
            return None
        near, often = self._near(limit - arc.t), self.sequence.recent_rows(2)
        located = [i for i in self.sequence.recent_rows() if i == k or i in near]
        # A surface that a fast motion passes once is no part of the accumulation.
        again = [i for i in located if i in often]
        still, recent = arc.system.p.law_still.copy(), self.sequence.recent.copy()
        for members in [located] + [again] * (again != located):
            if not members or not self._is_negligible(limit - arc.t, members):
                continue
            several = members + self._switching_together(members, near)
            if laws is not None:
                from lagsim.run.events.contacts import rest_soon

                rest_soon(arc, REACH * (limit - arc.t))
            self.sequence.recent.clear()
            found = self.select(arc, surfaces, laws, at_rest=several, time=limit)
            if found.decision.ending or not np.any(self.modes.bound[several]):
                arc.system.p.law_still[:] = still
                self.sequence.recent.extend(recent)
                continue  # of impacts `contacts` computes the limit
            zeno = [self._rested(arc, i, limit) for i in members]
            events = (*zeno, *found.decision.events)
            return found._replace(decision=found.decision._replace(events=events))
        return None

    def _is_negligible(self, left: float, surfaces: Collection[int]) -> bool:
        """Whether the motion across surfaces in a short time is below its resolution.

        The resolution is the tolerance times the range of the motion, plus the rounding
        of positions. The distance moved across a surface is estimated from the present
        speed across the surface, and from the terms of the forces.

        left : the time.
        surfaces : the indices of the surfaces.
        """
        modes, arc, n = self.modes, self.modes.arc, self.modes.arc.system.n
        rows, values = modes.rows(), modes.values(arc.t, arc.y)
        J, state = np.abs(rows.J), arc.state
        off = [abs(x - modes.level(k, x)) for k, x in enumerate(values.tolist())]
        speeds = np.where(self.on_rates, off, np.abs(rows.rates))
        far = left * (speeds + left * (J[:, :n] @ state.parts[:n]))
        ranges, magnitudes = (
            np.append(x[state.positions], x[state.first_order])
            for x in (arc.ranges_to(arc.y), arc.magnitudes)
        )
        least = arc.plan.tolerance * (J @ ranges) + RESIDUAL_ROUNDOFF * (J @ magnitudes)
        return bool(np.all((far <= least)[[*surfaces]]))

    def _near(self, within: float) -> list[int]:
        """Return the surfaces whose levels the motion can reach in the time `within`.

        Only these surfaces can take part in an accumulation that ends within this time.
        """
        modes = self.modes
        most = REGULAR * modes.changes(within)
        most += RESIDUAL_ROUNDOFF * modes.sizes()
        near: list[int] = np.flatnonzero(
            (modes.off_levels() <= most) & ~modes.shown
        ).tolist()
        return near

    def _switching_together(
        self, surfaces: Collection[int], near: Collection[int]
    ) -> list[int]:
        """Return the surfaces of `near` that switch together with `surfaces`.

        Their gradients are parallel: several kinks lie at one place, of which the
        search locates a single one at each switch.
        """
        J = self.modes.rows().J
        return [
            j
            for j in near
            if j not in surfaces and any(multiple_of(J[k], J[j]) for k in surfaces)
        ]

    def _rested(self, arc: Arc, k: int, time: float) -> Event:
        """Return the event, at `time`, of an accumulation of switches of surface k.

        At the corner of an equality the event has the name of the equality.
        """
        corner = arc.system.switches.corners.get(k)
        name = corner.rows[0] if corner else None
        return Event(time, "zeno", name, switch=self.sides[k].text)

    def _reached_to_rounding(self, arc: Arc) -> Decision | None:
        """Return the decision to settle where no step can pass the next surface.

        The surface counts as reached if the motion reaches it within the rounding of
        its argument or of the time. Steps cannot pass it if the branch in force has no
        finite value on the other side (a root, an inverse), or if they are too short
        to change the position: far from the origin no double may lie between the
        position and the surface. None if the motion reaches no surface.
        """
        k, ahead = self._next(arc)
        soon = ahead <= TIME_ROUNDOFF * abs(arc.t)
        if ahead < math.inf and (soon or self._is_on(arc, k)):
            return self._reached(arc, k)
        return None

    def _stuck(self, arc: Arc) -> Decision | None:
        """Return the decision where steps make no progress beside a surface.

        If the motion reaches a surface to rounding, the decision is to settle there. If
        the state is on a surface that it does not approach, a Taylor series is replaced
        by `ANY`, the method for every model. Else None.
        """
        reached = self._reached_to_rounding(arc)
        if reached is not None:
            return reached
        on = any(self._is_on(arc, k) for k in range(arc.system.acting_surfaces))
        if not on or arc.runner.method.NAME != SERIES:
            return None
        return handed_over(arc, BENT, {})._replace(turn=Turn.ARC)

    def _next(self, arc: Arc) -> tuple[int, float]:
        """Return the surface that the motion reaches next, and the time to it.

        The time is computed from the present rates; inf if no surface is approached.
        """
        modes = self.modes
        rows = modes.rows()
        speeds = np.where(self.on_rates, modes.forced(arc.y), rows.rates)
        values = modes.values(arc.t, arc.y)
        ends = np.where(speeds > 0, modes.p.most, modes.p.least)
        with np.errstate(divide="ignore", invalid="ignore"):
            ahead = np.where(modes.bound, math.inf, (ends - values) / speeds)
        ahead[~(ahead >= 0.0)] = math.inf
        k = int(np.argmin(ahead))
        return k, float(ahead[k])

    def _is_on(self, arc: Arc, k: int) -> bool:
        """Whether the argument of surface k is at an end of its present interval.

        The ends are the least and the largest value on the side of the surface; the
        argument is compared with each within rounding.
        """
        modes = self.modes
        value = modes.values(arc.t, arc.y)[k]
        off = min(abs(modes.p.least[k] - value), abs(modes.p.most[k] - value))
        return bool(off <= 8.0 * RESIDUAL_ROUNDOFF * modes.sizes()[k])


def corners_met(arc: Arc, levels: Collection[int]) -> list[int]:
    """Return the indices of the corners of equalities that the state is on.

    levels : the surfaces that the state is on.
    """
    return [k for k in levels if k in arc.system.switches.turns]
