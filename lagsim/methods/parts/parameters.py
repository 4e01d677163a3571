"""The parameters and the working memory shared by model functions and kernels."""

from __future__ import annotations

from functools import cached_property
from math import inf

from lagsim.language.arrays import Floats
from lagsim.native.layout import Block, Memory, after, array, block, part

# Value of `least_sigma` that requests the directions of the rows.
NOTE = 2.0

# Force at a corner, large against all forces; a power of two, so that scaling is exact.
PUSH = 2.0**100

# Values of `slides`, the mode of a surface, other than 0. FOLLOWED: the motion slides
# on the surface; REDUNDANT_SIDE: other surfaces or laws hold it there, and the share of
# the upper side is constant; CARRIED: the surface is carried along by another one.
# Below 0 the expression is at its level on a whole stretch (LEVEL), or its side is a
# choice (CHOSEN).
REDUNDANT_SIDE = 3.0
FOLLOWED = 2.0
CARRIED = 1.0
LEVEL = -1.0
CHOSEN = -2.0

# Arrays of knots and surfaces that remain from arc to arc, beside the modes.
KEPT = ("knot_times", "knot_modes", "cells_before", "cells_after", "share")

# Modes of laws: out of force; an equality; sliding with a given force; redundant,
# implied by other rows.
OFF = 0.0
HELD = 1.0
SLIDING = 2.0
REDUNDANT = 3.0
# The degree of the polynomial by which a slip's direction turns where it begins.
TURNS = 16


def each_coordinate(p: Parameters) -> int:
    """Return the length n of arrays with an entry per coordinate.

    It is 0 where the accelerations are solved without the loops of `program/dense`.
    """
    return p.n if p.loops else 0


def each_row(p: Parameters) -> int:
    """Return the length m of arrays with an entry per row; 0 as `each_coordinate`."""
    return p.m if p.loops else 0


def each_grouped(p: Parameters) -> int:
    """Return the length m of arrays with an entry per row; 0 without laws.

    Such arrays hold the group of each row.
    """
    return p.m if p.laws else 0


def each_watched(p: Parameters) -> int:
    """Return the length of arrays with an entry per surface, then per law."""
    return p.surfaces + p.laws


def columns(p: Parameters) -> int:
    """Return the length of `slopes`, the derivatives by the dynamic components of y.

    The (n + m + states + works) rows are those of the residuals of the equations of
    motion and of the constraint rows (see `program/dense.py`), then of the rates of
    first-order states and works.
    """
    return (p.n + p.m + p.states + p.works) * p.dynamic.stop


class Blocks(Memory):
    """The blocks of the state y (size,), by their roles.

    Second order: the coordinates q, then q'. First order: the states s. Quadratures, on
    which no rate depends: the works, then other integrals. `dynamic` contains all
    blocks but the quadratures.
    """

    n: int  # coordinates
    states: int  # number of first-order states
    size: int  # components of y
    positions: Block = block("n")
    velocities: Block = block(lambda s: 2 * s.n, "n")
    dynamic: Block = block(lambda s: s.velocities.stop + s.states)
    first_order: Block = block(lambda s: s.dynamic.stop, lambda s: s.velocities.stop)
    driven: Block = block(lambda s: s.dynamic.stop, "n")  # velocities and states
    quadratures: Block = block("size", lambda s: s.dynamic.stop)


class ModelParameters(Blocks):
    """The sizes and the parameters of a model, set by the run."""

    m: int  # number of constraint rows; the rows of laws come last
    works: int  # number of the quadratures
    values: int  # number of parameters and lengths of rows
    loops: int  # 1 if loops solve linear systems, which need working memory
    slopes_known: int  # 1 if the method needs the Jacobian
    augmented: float  # 1: M alone is singular
    gain: float  # the rate a of Baumgarte's stabilisation
    constant: float  # constant in an arc: 1 the factors of M; 2 also the factors of A

    fixed: Floats = array("values")
    # index of the work on each coordinate; or -1
    worked: Floats = array(lambda p: p.n * (p.works > 0))


class KnownPoints(ModelParameters):
    """Points of tables at known times, where y' has no jump.

    The run writes the next knots here; after each knot the kernel continues in the cell
    stored with it.
    """

    knots: int  # number of knots that the memory can hold
    known: float  # number of stored knots ...
    passed: float  # ... and number of passed knots
    knot_distance: float  # knots closer to each other than this are one knot

    knot_times: Floats = array("knots")
    # the number of the branch of the switch whose cell changes
    knot_modes: Floats = array("knots")
    cells_before: Floats = array("knots")
    cells_after: Floats = array("knots")


class ModeWords(KnownPoints):
    """The modes of an arc: of the file, branches of t, surfaces and laws.

    All numbers of these modes follow each other in the memory, and so do all arrays:
    see `run.modes`.
    """

    model_modes: int  # number of modes of the file, which events set
    switches: int  # number of switches of t alone
    surfaces: int  # number of surfaces of switches
    laws: int  # number of rows that hold at times

    sliding: float  # number of surfaces on which the fields of both sides are combined
    ends_above: float  # number of carried surfaces with ends above their leader
    law_forces: float  # 1 if multipliers determine the end of a mode
    law_shares: float  # 1 if redundant rows share loads

    file_modes: Floats = array("model_modes")
    branches: Floats = array("switches")  # the values of the switches of t alone
    side: Floats = array("surfaces")  # the mode variables, which select the branches
    slides: Floats = array("surfaces")  # modes of surfaces, see FOLLOWED
    # Values of the mode variable on the two sides of a surface that the motion follows.
    low: Floats = array("surfaces")
    high: Floats = array("surfaces")
    part_above: Floats = array("surfaces")  # the share of a REDUNDANT_SIDE
    # Bounds of the expression of the surface in its mode; while the motion slides, the
    # targets of the residual and of the rate.
    least: Floats = array("surfaces")
    most: Floats = array("surfaces")
    # Number, from 1, of the sliding surface that carries the surface along; or 0. The
    # bounds of a carried surface on the upper side of its leader.
    leader: Floats = array("surfaces")
    least_above: Floats = array("surfaces")
    most_above: Floats = array("surfaces")
    roundoff: Floats = array("surfaces")  # bound of the rounding of a rate in sliding
    # 1 where the expression of a surface that rests at its level depends on the side.
    decisive: Floats = array("surfaces")
    # Least argument of roots in the expression during the motion; see `switches.roots`.
    floor: Floats = array("surfaces")
    # the value of `floor` for states between rows
    least_root: Floats = array("surfaces")
    departed: Floats = array("surfaces")  # the level that a shown surface leaves
    slack: Floats = array(each_watched)  # distance past its end that a mode still lasts
    band: Floats = array(each_watched)  # distance past its end that exceeds rounding
    law_mode: Floats = array("laws")
    law_direction: Floats = array("laws")  # the sign of a force of known size
    law_still: Floats = array("laws")  # speed below which two slips have stopped
    # For a beginning slip of two components: the speed up to which its direction is
    # prescribed, 0 once it is faster; the time of the begin, the duration, and the
    # polynomial, in the elapsed part of the duration, by which the direction turns.
    law_floor: Floats = array("laws")
    law_begun: Floats = array("laws")
    law_lasts: Floats = array("laws", inf)
    law_turn: Floats = array(lambda p: TURNS * p.laws)
    # rounding of the law's margin while it is out of force
    law_rounding: Floats = array("laws")
    law_opens: Floats = array("laws")  # 1: opens in the step that an event has cut
    law_shared: Floats = array("laws")  # 1: redundant, and held by other laws alone
    # Largest change of each rate of the state by the laws of an arc.
    law_pushes: Floats = array(lambda p: p.size if p.laws else 0)

    @cached_property
    def modes(self) -> tuple[memoryview, memoryview]:
        """Views of the bytes of all numbers of modes, and of all arrays of modes."""
        first, last = self.fields["sliding"].word, self.fields["law_shares"].word
        whole = self.numbers
        arrays = whole[self.place("file_modes") : self.place_after("law_pushes")]
        return whole[first : last + 1].cast("B"), arrays.cast("B")


class Surfaces(ModeWords):
    """Memory of the surfaces at which switches step, and of the motion along them."""

    elements: int  # number of nonzero elements of their rows J
    corners: int  # number of surfaces that are corners of equalities
    shown_width: int  # number of columns of an output row

    # Share of the upper side in the combination of forces that stays on the surface.
    share: Floats = array("surfaces")
    on_rates: Floats = array("surfaces")  # 1: its expression contains rates that jump
    is_whole: Floats = array("surfaces")  # 1: levels are whole numbers; 0: the level 0
    # 1 for a corner of an equality; a force along its gradient; the jumps of this
    # force.
    corner: Floats = array("surfaces")
    push: Floats = array("surfaces")
    levers: Floats = array(lambda p: p.surfaces * (1 + p.m) if p.corners else 0)
    levers_above: Floats = array(lambda p: p.surfaces * (1 + p.m) if p.corners else 0)
    # Levels of tables that are passed without a jump of y' (first to last), and levels
    # that are passed by the rate of the surface, see `surfaces.Side`.
    first_smooth: Floats = array("surfaces")
    last_smooth: Floats = array("surfaces")
    first_met: Floats = array("surfaces")
    last_met: Floats = array("surfaces")
    # Copies of the sides, and of `slides`, while a row is evaluated with other sides.
    side_before: Floats = array("surfaces")
    slides_before: Floats = array("surfaces")
    # time of the last instant, for all surfaces
    settled: Floats = array("surfaces", inf)
    # Distance from its level up to which the value of a shown surface may be rounding,
    # -1 for other surfaces; the magnitudes of components up to which this holds.
    far: Floats = array("surfaces", -1.0)
    far_up_to: Floats = array(lambda p: p.size if p.surfaces else 0, -1.0)
    shown_decided: float  # the result of `departures.shown_are_decided`
    shown_values: Floats = array("surfaces")  # its working memory
    # Distance of the expression of a carried surface from its bounds above.
    margin_above: Floats = array("surfaces")
    # Where the rows of J begin among its elements, and the column of each.
    row_starts: Floats = array(lambda p: p.surfaces + 1)
    row_columns: Floats = array("elements")
    # Values of `surface_rows`: residuals, rates, b, scales, and the elements.
    rows: Floats = array(lambda p: 4 * p.surfaces + p.elements)
    residuals: Floats = part("rows", "surfaces")
    rates: Floats = after("residuals", "surfaces")
    required: Floats = after("rates", "surfaces")
    surface_scales: Floats = after("required", "surfaces")
    J: Floats = part("rows", "elements", lambda p: 4 * p.surfaces)
    # The fields on both sides, the equations for the shares, a state.
    side_fields: Floats = array(
        lambda p: (p.surfaces + 1) * (p.size + p.m) if p.surfaces + p.laws else 0
    )
    # Output rows on the upper side of a surface, and on the lower sides.
    shown: Floats = array(lambda p: 2 * p.shown_width if p.surfaces else 0)
    B: Floats = array(lambda p: p.surfaces * p.surfaces)
    right: Floats = array(lambda p: 3 * p.surfaces)
    former: Floats = array(lambda p: p.size if p.surfaces else 0)


class Laws(Surfaces):
    """Memory of the rows that hold at times: contacts, friction, limits."""

    # Columns of `mechanics.rows.RowTable`, by which kinds of laws differ.
    law_low: Floats = array("laws")
    law_high: Floats = array("laws")
    law_gapped: Floats = array("laws")
    law_varies: Floats = array("laws")  # 1: a bound that follows the motion
    # 1: a static bound of its own, which depends on time or place
    law_weakens: Floats = array("laws")
    # For each row that shares a load: its target and its share; the Newton step of the
    # shares.
    share_target: Floats = array("laws")
    share_found: Floats = array("laws")
    share_step: Floats = array("laws")
    share_next: Floats = array("laws")
    share_gradient: Floats = array("laws")
    law_normal: Floats = array("laws")  # the law of a slip's contact; or -1
    law_pair: Floats = array("laws")  # the other of two slips; or -1
    # The only coordinate on which a row acts; or -1.
    law_place: Floats = array("laws", -1.0)
    # factor of the contact's multiplier, or the force itself
    law_part: Floats = array("laws")
    impulses: Floats = array("laws")  # impulses of an impact, while its row is written
    kicked_rows: int  # number of equalities in a model whose events give impulses
    row_impulses: Floats = array("kicked_rows")  # impulses of these equalities


class Parameters(Laws):
    """Complete parameters: laws, rank of the constraint rows, working memory."""

    reached: int  # number of ranges of columns in the reach of all rows
    neighbours: int  # number of pairs of rows whose reaches overlap

    # Column of the first element of each row of L, M = L L^T, that is not always 0.
    inertia_first: Floats = array("n")
    # The following integers are stored as bits. The reach of a row: the columns of
    # L^-1 A^T, and of the friction with the row's multiplier, that are not always 0, as
    # ranges: the index of the first range of each row, and the first and the last
    # column, exclusive, of each range.
    reach_starts: Floats = array(lambda p: each_row(p) + 1)
    reach_begins: Floats = array("reached")
    reach_ends: Floats = array("reached")
    # For each row, the rows whose reach overlaps its own; it is one of these rows.
    near_starts: Floats = array(lambda p: p.m + 1 if p.laws else 0)
    near_rows: Floats = array("neighbours")
    expected: float  # the generic rank of the rows
    reference: float  # the largest sigma so far, with which sigma is compared ...
    usual_reference: float  # ... and the sigma of the plan, at the start of an arc
    sigma: float  # length of the last independent column at the current state
    least_sigma: float  # the smallest sigma since a kernel set this to 1
    factored: float  # 1: L of M is known; 2: also the factors of S
    noted: float  # number of stored directions of the rows
    lasting: float  # the largest value of `factored` while the modes of laws stay
    least_pivot: float  # least pivot of the matrices S of the rows that hold
    ranked: float  # the rank at the last factorisation

    # From here on arrays are valid within an arc only: first q'' and lambda, which the
    # model reads.
    motion: Floats = array(lambda p: p.n + p.m)
    multipliers: Floats = part("motion", "m", "n")
    lengths: Floats = array(each_row)  # the largest length of each row in the arc ...
    usual_lengths: Floats = array(each_row)  # ... and in the plan
    aside: Floats = array(each_row)  # 1 for rows that are excluded as dependent
    # Values of `dynamics`; or of `geometry`, with residuals, rates and the scales of
    # both in place of f and b.
    terms: Floats = array(lambda p: (p.n + p.m) * p.n + p.n + 4 * p.m if p.loops else 0)
    M: Floats = part("terms", lambda p: each_coordinate(p) * p.n)
    A: Floats = after("M", lambda p: each_row(p) * p.n)
    f: Floats = after("A", each_coordinate)
    b: Floats = after("f", each_row)
    gaps: Floats = after("A", each_row)
    gap_rates: Floats = after("gaps", each_row)
    # Speeds and bounds of laws.
    law_speeds: Floats = after("b", "laws")
    law_bounds: Floats = after("law_speeds", "laws")
    law_statics: Floats = after("law_bounds", "laws")
    gap_scales: Floats = after("gap_rates", each_row)
    rate_scales: Floats = after("gap_scales", each_row)
    Z: Floats = array(lambda p: p.m * p.n if p.laws else 0)  # forces of rows that hold
    # Matrices of the groups of rows that hold, one after the other.
    S: Floats = array(lambda p: p.m * p.m if p.laws else 0)
    # Groups of rows that hold, coupled by overlapping reaches. For each group, as bits:
    # the first and last place among all rows that hold, the index of its matrix in S,
    # and the largest distance of coupled rows. For each row: 1 if it holds, else 0, and
    # -1 before the first grouping; its group; its place, as bits.
    groups: float
    group_starts: Floats = array(each_grouped)
    group_ends: Floats = array(each_grouped)
    group_matrices: Floats = array(each_grouped)
    group_bands: Floats = array(each_grouped)
    row_holds: Floats = array(each_grouped, -1.0)
    row_group: Floats = array(each_grouped)
    row_place: Floats = array(each_grouped)
    # For each row that holds, by its place: the only column of its reach, or -1; the
    # elements of A and Z there.
    only_column: Floats = array(each_grouped, -1.0)
    only_entry: Floats = array(each_grouped)
    only_force: Floats = array(each_grouped)
    # Held rows of laws with one element of A: their number; the row, the column, and
    # the element of each.
    stills: float
    still_rows: Floats = array("laws")
    still_columns: Floats = array("laws")
    still_entries: Floats = array("laws")
    # second-order residuals after Newton steps ...
    left: Floats = array(lambda p: 2 * each_row(p))
    # ... and the state of these steps
    tried: Floats = array(lambda p: p.dynamic.stop if p.loops else 0)
    L: Floats = array(lambda p: each_coordinate(p) * p.n)
    pivots: Floats = array(each_coordinate)  # the diagonal of L
    Y: Floats = array(lambda p: each_row(p) * p.n)
    # the column with which each column was exchanged
    places: Floats = array(each_coordinate)
    u: Floats = array(each_coordinate)
    v: Floats = array(each_coordinate)
    # For each row, in the order of elimination: its scale, the right side, and w of R^T
    # w; the diagonal of R, the factor of its reflection, its index, and working memory.
    scales: Floats = array(each_row)
    w: Floats = array(each_row)
    diagonal: Floats = array(each_row)
    factors: Floats = array(each_row)
    full: Floats = array(each_row)  # 0: first columns of a full matrix
    order: Floats = array(each_row)
    x: Floats = array(each_row)
    free: Floats = array(lambda p: each_row(p) * p.m)  # working memory of `multipliers`
    # The directions z of the rows, orthonormal in the metric of M, and M z for each.
    mirrored: Floats = array(each_coordinate)
    directions: Floats = array(lambda p: each_coordinate(p) * min(p.n, p.m))
    momenta: Floats = array(lambda p: each_coordinate(p) * min(p.n, p.m))
    # Values of `slopes`, last the derivatives by q'' and lambda. A column of the
    # Jacobian.
    slopes: Floats = array(
        lambda p: (columns(p) + (p.states + p.works) * (p.n + p.m)) * p.slopes_known
    )
    by_motion: Floats = part(
        "slopes",
        lambda p: (p.states + p.works) * (p.n + p.m) * p.slopes_known,
        columns,
    )
    column: Floats = array(lambda p: (p.n + p.m) * p.slopes_known)

    @cached_property
    def begun(self) -> memoryview:
        """View of the numbers, `reference` to `noted`, with which each arc begins."""
        first, last = self.fields["reference"].word, self.fields["noted"].word
        words: memoryview = self.numbers[first : last + 1]
        return words
