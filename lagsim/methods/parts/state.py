"""The one array that carries a method from call to call: where everything lies in it.

Between two calls of `advance` nothing else is kept, so a run can be paused, shown
progress, interrupted and resumed at no cost.

After the header lie, for a state of `size` components: y (size), their largest sizes
(size), tolerances (size), what `measure` gave (size + 2), with the sum of M_ii a_i^2
that forces could make in the place of its 0, work (2 size + 4), and from
HEADER + 6 size + 6 on whatever the method needs; last what `note_inertias` follows.
"""

from __future__ import annotations

from lagsim.native.graph.sincos import LANES

T = 0  # time reached
END = 1  # where the arc ends
H = 2  # the next step; 0 before it has been chosen
PREVIOUS_ERROR = 3  # of the last accepted step, for PI control
RTOL = 4
ATOL = 5  # below 0: rtol times the component's own scale
ROW_START = 6  # row k is at ROW_START + k*ROW_STEP ...
ROW_STEP = 7
ROW_LIMIT = 8  # ... while that is less than this
ROW = 9  # the next row
EMITTED = 10  # rows written by this call
STEPS = 11
REJECTIONS = 12
EVALUATIONS = 13
STEP_T = 14  # the last step: where it began ...
STEP_H = 15  # ... and its length; 0 before the first
FRESH = 16  # 1 at the start of an arc
ENERGY = 17  # the largest kinetic energy or change of potential so far
POTENTIAL = 18  # at the start of the run
ORIENTATION = 19  # `until` holds where this times the condition is <= 0; 0: not armed
EQUATION = 20  # 1 if `until` is an equation
EVENT = 21  # 1 once `until` has been located
HEALTH = 22  # how independent the rows are: about their smallest singular value
N = 23  # coordinates
SIZE = 24  # components of y
FIXED_STEP = 25  # for fixed-step methods
ARC_START = 26
PREVIOUS_HEALTH = 27  # before the last step
CLOSE_BELOW = 28  # a health below this is close to a loss of rank
LOST_BELOW = 29  # which is a least health below this
DEGENERATE_BELOW = 30  # at a health below this the kernel returns; 0: never
LOST_AT = 31  # where rank was lost last
HEALTH_SLOPE = 32  # the steepest change of the health so far
WATCHED = 33  # 1 if the last step is to be searched for a loss of rank
SPECTRAL_RADIUS = 34  # at infinite frequency, for methods that have it as a parameter
SWITCHED = 35  # the number, from 1, of the surface that a switch was located on; or 0
CUT = 36  # the fraction of the last step that counts, until its rows are written; or 0
FACTORISATIONS = 37  # made by the method itself, and for the Jacobian
SPEED = 38  # about how fast the fastest motion is, for explicit methods
AT_BOUND = 39  # steps held by stability ...
OFF_BOUND = 40  # ... since when so many were not
ASK_AT = 41  # at so many the kernel returns; 0: never
SIZES_BEFORE = 42  # where sizes and extents before the last step are; see switches
SMALLEST_STEP = 43  # once the first steps have found their size; 0: none yet
INERTIAS = 44  # how many are followed, whether they vanish on the way ...
INERTIAS_AT = 45  # ... and where: the largest, the smallest and its time, of each
LANES_AT = 46  # where the memory for rows side by side is; see _projection
PASSES = 47  # 1 where the step tried last was to pass a loss of rank
FALLING = 48  # how fast the health fell last, per unit of time
EXTENTS_AT = 49  # where `_controller` keeps what scales of errors are made of
LOOKED = 50  # 1 once rounding has been looked at in this step
MOST_STEP = 51  # no step is longer until one has been made; 0: no such limit
SUSPECT = 52  # 1 if the last step is to be searched for what it may have leapt over
SIGNALS = 53  # how many arguments of functions that may sleep are watched ...
LOOKS_AT = 54  # ... and where the memory for that is; see _looks
FEATURE = 55  # about this time something short happens that depends on t alone ...
FEATURE_WIDTH = 56  # ... of this width; 0: nothing is known of
FEATURE_REACH = 57  # it counts from so far before it ...
FEATURE_END = 58  # ... to this time
LONGEST = 59  # no step is longer than this; 0: any
PLANNED = 60  # the step that will pass a loss of rank, once there is room for it; or 0
PLANNED_AT = 61  # when that was planned
TRIED = 62  # the error of the last step that was to pass and could not; or 0
SEARCH_AT = 63  # where the memory is for what ends a step early; see _switching
PULLED = 64  # the farthest that a state was pulled onto what it slides along, against
# the motion so far
HEADER = 65


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


def lanes_size(size: int) -> int:
    """Give how much memory rows side by side need."""
    return LANES * (1 + size + (size // 2 + 3) + 2)


def extents_size(size: int) -> int:
    """Give how much memory the scales of errors need.

    The least and the largest value of each component, the terms of its rate, the
    rounding of that, and what becomes of one at rest in the first instant.
    """
    return 5 * size
