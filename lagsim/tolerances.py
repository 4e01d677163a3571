"""Tolerances: constants that decide that a number is zero, equal, small or done.

Each stands here once, with its meaning. Where rounding decides, the value is a multiple
of the unit roundoff; where an error of a method or of a solve decides, it is a share of
the scale that its docstring names. Budgets (how many, how long, how large a file) stand
in `limits`; coefficients, safety factors and step ratios of a method in its file.
Kernels read these like any global of their module: they are constants when compiled.
"""

from __future__ import annotations

# --- floating-point numbers -----------------------------------------------------------

UNIT_ROUNDOFF = 2.0**-53
"""The largest relative error of one operation in double precision."""

OVERFLOW = 1e300
"""The size from which on a number counts as not finite: what follows may overflow."""

UNDERFLOW = 2.0**-1068
"""The size below which a number has no digits: some of the least steps between two."""

TINY = 1e-300
"""What a divisor, or the argument of a logarithm, is at least: it has no zero then."""

SHORTEST_RUN = 1e-290
"""The length of a run from which on doubles tell its rows and its steps apart."""

SQUARABLE = 1e140
"""The size up to which squares, and sums of some of them, are finite."""

# --- rounding -------------------------------------------------------------------------

STATE_ROUNDOFF = 4.0 * UNIT_ROUNDOFF
"""The relative error of a component of the state: what a double leaves of it, a few
times. No tolerance is below it, and an entry that such a change makes is zero."""

TERM_ROUNDOFF = 8.0 * UNIT_ROUNDOFF
"""The relative error of a few operations: numbers that differ by less are equal, and a
residual this small against its terms is rounding, whatever led to it."""

TIME_ROUNDOFF = 16.0 * UNIT_ROUNDOFF
"""The shortest step, as a part of t: below it a step makes no progress."""

TIGHTEST_RTOL = 1e-14
"""The relative tolerance of a step below which none means anything."""

RATE_ROUNDOFF = 32.0 * UNIT_ROUNDOFF
"""What the rounding of rates leaves in an error estimate, as a part of them."""

RESIDUAL_ROUNDOFF = 64.0 * UNIT_ROUNDOFF
"""The residual of a constraint after a Newton step, as a part of its terms."""

SURFACE_ROUNDOFF = 512.0 * UNIT_ROUNDOFF
"""How far off a surface rounding leaves a state, as a part of its size."""

VALUE_ROUNDOFF = 32.0 * UNIT_ROUNDOFF
"""The relative error of a column that was computed from others of its size."""

MOTION_ROUNDOFF = 128.0 * UNIT_ROUNDOFF
"""The change of a coordinate that is rounding, as a part of its values or of the motion
that it is linked with: a Newton step onto constraints, or the range of what rests."""

DOUBLE_ROOT = 2.0**-26
"""The relative error of a value that was found as a double root: half of the digits."""

FORCE_ROUNDOFF = 128.0 * UNIT_ROUNDOFF
"""The sum of forces that balance, as a part of what each of them could do."""

PROBE = 2.0**-36
"""The relative change of a state that shows what its rounding does to y': large enough
that the difference has digits, small enough that nothing bends."""

CLEAR_OF_ROUNDING = 16.0
"""How many times its rounding a value is, at least, that is none: a surface that has
been left, a flight that is one, a rate that jumps."""

SAME_TIME = 8.0
"""Units in the last place of the time within which two times are one."""

# --- rows of a run --------------------------------------------------------------------

SAME_ROW = 1e-6
"""Times of rows that differ by this part of their spacing, or of the run, are the same:
an event is located to the tolerance of the run."""

FLAT_RANGE = 1e-9
"""The range of a series, as a part of its size or of the motion beside it, that is
rounding: it is constant."""

ZERO_BESIDE = 1e-14
"""The size of a column, against others of its unit, that is rounding: it is zero."""

PLACE_BESIDE = 1e-12
"""A place is known no better than to this part of the motion beside it."""

NO_MOTION = 1e-6
"""What moves by less than this part of what moves beside it has no motion to lose."""

SATISFIED = 1e-6
"""The residual of a constraint, against its scale, up to which it is satisfied in rows,
at the start, or where it comes into force: steps leave rounding, a million times more
is none; starts that were typed have six digits."""

ENERGY_DRIFT = 1e-6
"""The drift of the energy, as a part of that in play, that is named: the default
tolerance leaves 1e-9."""

ENERGY_ROUNDOFF = 1e-13
"""What rounding leaves of an energy, as a part of its own size, between neighbours."""

SAME_ENERGY = 1e-10
"""Shares of the energy whose sum differs from the whole by this part are all of it."""

SAME_JUMP = 1e-6
"""Jumps of the energy that differ by this part are of one size."""

# --- iterations -----------------------------------------------------------------------

CONVERGED = 1e-12
"""What Newton's method leaves: of a residual against its terms, of a step against the
values, of a gradient against the change; and what numbers that were computed elsewhere
leave in a rate, against the motion."""

STALLED_STEP = 1e-9
"""The Newton step against the state up to which steps of an implicit method may stop
shrinking."""

SAME_STEP = 1e-9
"""Steps, and times, that differ by this part of a step are the same."""

HALF_OF_DIGITS = 1e-6
"""What is solved for, beside 1 or its scale, is known to about half of the digits:
roots, shares and directions that differ by less are the same, or none."""

LEAST_PIVOT = 1e-13
"""The least pivot, or inertia in passing, as a part of the terms that it is left of:
three digits are right then, which is enough for iterations."""

SETTLED_EIGENVALUE = 1e-6
"""The relative change of an eigenvalue at which inverse iteration ends."""

SETTLED_IMPULSE = 1e-10
"""The change of its own rate, by an impulse, at which relaxation of impulses ends, as a
part of the rates around it."""

SETTLED_POSITION = 1e-11
"""The step against the size of the positions that ends the search of an equilibrium."""

# --- zero, beside a scale -------------------------------------------------------------

DEPENDENT_ROWS = 1e-10
"""The singular value of scaled constraint rows, and the eigenvalue of a scaled mass
matrix, against the largest, below which it is zero: rows at an angle of 1e-9 are two
constraints."""

SAFELY_INDEPENDENT = 1e-5
"""Such a value above which it is not zero, known by inverse iteration to 1e-6."""

LOST_RANK = 1e-8
"""Such a value, against its largest on the way, below which rank is lost in passing:
what would be divided by it is rounding."""

NEARLY_DEPENDENT_ROWS = 1e-2
"""The smallest singular value of scaled rows below which they are solved by QR: normal
equations square their condition, and lambda loses half of its digits."""

NEUTRAL_EIGENVALUE = 1e-6
"""The eigenvalue, against the largest, of a neutral direction: rounding sets its two
zeros apart by the root of its size."""

ASYMMETRY = 1e-8
"""The asymmetry of a stiffness matrix, against it, where an energy gives the forces."""

RESIDUAL_FORCE = 1e-6
"""The force at an equilibrium, as a part of those around the start: at the centre of an
attraction steps become small as well."""

SLIP_AT_REST = 1e-8
"""The slip, as a part of its rates, that relaxation leaves of one that rests."""

CONTRADICTION = 1e-8
"""The difference of what dependent rows ask for, against its size, that is none:
rounding, and starts that were typed."""

VANISHING_LENGTH = 1e-8
"""The length of a relation, against the longest, that is that of a gradient which all
but vanishes."""

DEPENDENT_FIELDS = 1e-7
"""The part of a vector outside of a span, against its length, that is none, where
brackets of fields span it."""

UNCOUPLED = 2.0**-100
"""The norm of what acts back, against that of a matrix, that counts as none."""

# --- stability of methods -------------------------------------------------------------

COMPUTED_ZERO = 1e-9
"""What counts as 0 beside 1, or beside the largest of its kind: the rounding of an
eigenvalue, of a mode, of a stiffness, of an equilibrium, of a row of a surface."""

NEGLIGIBLE_RATE = 1e-2
"""The size of an eigenvalue times the length of a run below which it does nothing."""

AMPLIFICATION_ROUNDOFF = 1e-8
"""What rounding leaves of an amplification of 1: half of the digits, where eigenvalues
of a step meet."""

ENERGY_CHANGE = 1e-2
"""The change of energy less work within a run, as a part of the energy of the motion,
that is growth or decay in a map of stability."""

BROKEN_CONSTRAINT = 1e-3
"""The residual of a constraint, against its scale, that is no motion on it at all."""

# --- contacts and surfaces of switches ------------------------------------------------

ACCELERATION_ROUNDOFF = 512.0 * UNIT_ROUNDOFF
"""The relative error of an acceleration against all that pushes: terms may cancel."""

SHARE_ROUNDOFF = 1e-12
"""How far past its bounds the share of a side may be, and the rate of a surface against
its terms, that still counts as on it; and the pivot of shares against its column that
is none: of the forces only the sum matters."""

MISSED_SURFACE = 1e-9
"""The rate, against its terms, with which shares no longer keep to their surface."""

DEPENDENT_SQUARE = 1e-14
"""The singular value of a Delassus matrix below which it is zero: it is a square, so
that this is an angle of 1e-7 between rows."""

DEPENDENT_SQUARED = 1e-7
"""The same for rows of which only the Delassus matrix is known."""

TABLEAU_ROUNDOFF = 1e-11
"""What is no pivot in a tableau of entries near 1."""

SAME_RATIO = 1e-12
"""Ratios of a tableau that differ by less are tied: order decides, and no rounding."""

SOLVED_LAWS = 1e-7
"""The residual of contact laws, against their terms, up to which they are solved."""

SLIP_CONVERGED = 1e-10
"""The slip on a disc, against its terms, that Newton's method leaves of one that rests,
where dependent rows slow it down."""

LEAST_CLOSING = 1e-10
"""The tolerance below which no contact closes: what a series of impacts leaves where it
is taken to have ended."""

NO_IMPULSE = 1e-12
"""The impulse against the largest of an impact, and the answer of a contact to one of
another against that to its own, that is rounding."""

IMPACT_GAIN = 1e-9
"""The energy that an impact gives, as a part of what is exchanged, that is named."""
