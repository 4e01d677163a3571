"""The memory that carries a method from call to call.

Between two calls of `advance` nothing else is kept, so a run can be paused, shown
progress, interrupted and resumed at no cost. Each method adds its own to a subclass.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

from lagsim.native.layout import Memory, array, part

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats


class State(Memory):
    """What every method keeps."""

    n: int  # coordinates
    size: int  # components of y
    signals: int  # arguments of functions that may sleep, which are watched
    surfaces: int  # that switches are located on, and laws whose modes end
    inertias: int  # which are followed, whether they vanish on the way
    # Of Newton's matrix where it is sparse: rows, entries, those of its factors.
    unknowns: int
    entries: int
    filled: int

    t: float  # time reached
    end: float  # where the arc ends
    h: float  # the next step; 0 before it has been chosen
    previous_error: float  # of the last accepted step, for PI control
    rtol: float
    atol: float  # below 0: rtol times the component's own scale
    row_start: float  # row k is at row_start + k*row_step ...
    row_step: float
    row_limit: float  # ... while that is less than this
    row: float  # the next row
    extras: float  # states asked for beside the rows that are still to be written ...
    extra: float  # ... and the time of the next
    emitted: float  # rows written by this call
    steps: float
    rejections: float
    evaluations: float
    step_t: float  # the last step: where it began ...
    step_h: float  # ... and its length; 0 before the first
    fresh: float  # 1 at the start of an arc
    energy: float  # the largest kinetic energy or change of potential so far
    potential: float  # at the start of the run
    # `until` holds where this times the condition is <= 0; 0: not armed
    orientation: float
    equation: float  # 1 if `until` is an equation
    event: float  # 1 once `until` has been located
    health: float  # how independent the rows are: about their smallest singular value
    fixed_step: float  # for fixed-step methods
    arc_start: float
    previous_health: float  # before the last step
    close_below: float  # a health below this is close to a loss of rank
    lost_below: float  # which is a least health below this
    degenerate_below: float  # at a health below this the kernel returns; 0: never
    lost_at: float  # where rank was lost last
    health_slope: float  # the steepest change of the health so far
    watched: float  # 1 if the last step is to be searched for a loss of rank
    # At infinite frequency, for methods that have it as a parameter.
    spectral_radius: float
    switched: float  # the number, from 1, of the surface a switch was located on; or 0
    cut: (
        float  # the fraction of the last step that counts, until rows are written; or 0
    )
    factorisations: float  # made by the method itself, and for the Jacobian
    speed: float  # about how fast the fastest motion is, for explicit methods
    at_bound: float  # steps held by stability ...
    off_bound: float  # ... since when so many were not
    ask_at: float  # at so many the kernel returns; 0: never
    smallest_step: float  # once the first steps have found their size; 0: none yet
    passes: float  # 1 where the step tried last was to pass a loss of rank
    falling: float  # how fast the health fell last, per unit of time
    looked: float  # 1 once rounding has been looked at in this step
    most_step: float  # no step is longer until one has been made; 0: no such limit
    suspect: (
        float  # 1 if the last step is to be searched for what it may have leapt over
    )
    feature: (
        float  # about this time something short happens that depends on t alone ...
    )
    feature_width: float  # ... of this width; 0: nothing is known of
    feature_reach: float  # it counts from so far before it ...
    feature_end: float  # ... to this time
    longest: float  # no step is longer than this; 0: any
    doubted: float  # the row at which a step differed last, see `strays`
    planned: float  # the step that will pass a loss of rank, once it has room; or 0
    planned_at: float  # when that was planned
    tried: float  # the error of the last step that was to pass and could not; or 0
    # The farthest a state was pulled onto what it slides along, against the motion.
    pulled: float
    unsettled: float  # steps whose impulses were not found to the end
    fixed_rows: float  # 1 where all constraints hold positions, and none moves
    missed: float  # the largest residual, of its scale, that a projection began with
    met: float  # rows up to this part of the last step are not projected

    y: Floats = array(lambda s: s.size)
    # What rounding has cut off of y, and what the step that is made leaves of it; see
    # `noise`.
    rest: Floats = array(lambda s: s.size)
    left: Floats = array(lambda s: s.size)
    sizes: Floats = array(lambda s: s.size)  # the largest of y so far
    tolerances: Floats = array(lambda s: s.size)
    # What `measure` gives: energies, the diagonal of M, and a 0 in the place of which
    # the sum of M_ii a_i^2 that forces could make is kept.
    measured: Floats = array(lambda s: s.n + 3)
    energies: Floats = part("measured", lambda _: 0, lambda _: 2)
    masses: Floats = part("measured", lambda _: 2, lambda s: s.n)
    pushes: Floats = part("measured", lambda s: s.n + 2, lambda _: 1)
    work: Floats = array(lambda s: 2 * s.size + 4)  # for a state ...
    spare: Floats = part("work", lambda s: s.size, lambda s: s.size + 4)  # ... and more
    ahead: Floats = array(lambda s: s.n + 3)  # what `velocity_step` gives there

    # Scales of errors: the least and the largest value of each component, the terms of
    # its rate, the rounding of that, what becomes of one at rest in the first instant.
    low: Floats = array(lambda s: s.size, inf)
    high: Floats = array(lambda s: s.size, -inf)
    parts: Floats = array(lambda s: s.size)
    noise: Floats = array(lambda s: s.size)
    foreseen: Floats = array(lambda s: s.size)
    joined: Floats = array(lambda s: s.n)  # to which mechanism a coordinate belongs
    linked: Floats = array(lambda s: s.n)  # ... where rows alone count, and not M
    # The largest tolerance of what is linked, at the place of its first coordinate;
    # the energy that each work is compared with.
    shared: Floats = array(lambda s: s.size - s.n)
    # Sizes, least and largest values before the last step; see `driver.keep_sizes`.
    sizes_before: Floats = array(lambda s: s.size)
    low_before: Floats = array(lambda s: s.size)
    high_before: Floats = array(lambda s: s.size)

    # Of each signal: its kind, the power that goes with it, the farthest it has been
    # since it was close; at three looks and beside one values, then rates. See `looks`.
    kinds: Floats = array(lambda s: s.signals)
    powers: Floats = array(lambda s: s.signals)
    farthest: Floats = array(lambda s: s.signals)
    signals_first: Floats = array(lambda s: 2 * s.signals)
    signals_middle: Floats = array(lambda s: 2 * s.signals)
    signals_last: Floats = array(lambda s: 2 * s.signals)
    signals_beside: Floats = array(lambda s: 2 * s.signals)  # a rounded state's
    # A look: y and y' there; states beside it, and y' from the equations.
    look: Floats = array(lambda s: 2 * s.size)
    look_rates: Floats = part("look", lambda s: s.size, lambda s: s.size)
    far_before: Floats = array(lambda s: s.size)
    far_after: Floats = array(lambda s: s.size)
    near_before: Floats = array(lambda s: s.size)
    asked: Floats = array(lambda s: s.size)

    # Margins of surfaces and of `until` at a look; with their slopes, at the start of a
    # stretch, within it and at its end. See `switching`.
    margins: Floats = array(lambda s: s.surfaces + 1)
    margins_first: Floats = array(lambda s: 2 * s.surfaces + 2)
    margins_middle: Floats = array(lambda s: 2 * s.surfaces + 2)
    margins_last: Floats = array(lambda s: 2 * s.surfaces + 2)

    # Of each inertia: the largest, the smallest, its time, and q and q' there.
    inertia_largest: Floats = array(lambda s: s.inertias)
    inertia_smallest: Floats = array(lambda s: s.inertias, inf)
    inertia_when: Floats = array(lambda s: s.inertias)
    inertia_where: Floats = array(lambda s: 2 * s.n * s.inertias)


# The spectral radius of the methods that have it, unless another is asked for.
USUAL_RADIUS = 0.8

# What `advance` and `step` return.
DONE = 0
BLOCK_FULL = 1
PAUSED = 2
EVENT_FOUND = 3
STEP_TOO_SMALL = 4
NOT_FINITE = 5
PROJECTION_FAILED = 6
DEGENERATE = 7
RANK_LOST = 8
SWITCH_FOUND = 9
NEWTON_FAILED = 10
STIFF = 11
FEATURE_PASSED = 12
LOSS_AHEAD = 13
