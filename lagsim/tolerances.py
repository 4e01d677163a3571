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

RESIDUAL_ROUNDOFF = 64.0 * UNIT_ROUNDOFF
"""The residual of a constraint after a Newton step, as a part of its terms."""

SURFACE_ROUNDOFF = 512.0 * UNIT_ROUNDOFF
"""How far off a surface rounding leaves a state, as a part of its size."""

VALUE_ROUNDOFF = 32.0 * UNIT_ROUNDOFF
"""The relative error of a rate, or of a column that was computed from others of its
size."""

SUM_ROUNDOFF = 128.0 * UNIT_ROUNDOFF
"""What rounding leaves of a sum of many terms, as a part of these: of forces that
balance, and of the change of a coordinate beside its values or the motion that it is
linked with (a Newton step onto constraints, the range of what rests)."""

DOUBLE_ROOT = 2.0**-26
"""The relative error of a value that was found as a double root: half of the digits."""

PROBE = 2.0**-36
"""The relative change of a state that shows what its rounding does to y': large enough
that the difference has digits, small enough that nothing bends."""

CLEAR_OF_ROUNDING = 16.0
"""How many times its rounding a value is, at least, that is none: a surface that has
been left, a flight that is one, a rate that jumps."""

SAME_TIME = 8.0
"""Units in the last place of the time by which a located time may be off: within them
what changes with the time has not changed."""

SAME_INSTANT = 2.0**-50
"""The difference of two times, as a part of the larger of them and the start, up to
which they are one instant: 4 units in the last place."""

# --- rows of a run --------------------------------------------------------------------

SAME_ROW = 1e-6
"""Times of rows that differ by this part of their spacing, or of the run, are the same:
an event is located to the tolerance of the run."""

ZERO_BESIDE = 1e-14
"""The size of a column, against others of its unit, that is rounding: it is zero."""

PLACE_BESIDE = 1e-12
"""A place is known no better than to this part of the motion beside it."""

NO_MOTION = 1e-6
"""What moves by less than this part of what moves beside it has no motion to lose."""

SATISFIED = 1e-6
"""The residual of a constraint, against its scale, up to which it is satisfied in rows,
at the start, or where it comes into force, and that of an equilibrium against the
forces around it: steps leave rounding, a million times more is none; starts that were
typed have six digits."""

ENERGY_DRIFT = 1e-6
"""The drift of the energy, as a part of that in play, that is named: the default
tolerance leaves 1e-9."""

ENERGY_ROUNDOFF = 1e-13
"""What rounding leaves of an energy, as a part of its own size, between neighbours."""

SAME_ENERGY = 1e-10
"""Shares of the energy whose sum differs from the whole by this part are all of it."""

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
roots, shares, directions, eigenvalues and jumps that differ by less are the same, or
none. Rounding sets two zeros of a spectrum apart by the root of its size."""

LEAST_PIVOT = 1e-13
"""The least pivot, or inertia in passing, as a part of the terms that it is left of:
three digits are right then, which is enough for iterations."""

SETTLED_IMPULSE = 1e-10
"""The change of its own rate, by an impulse, at which iterations for impulses end, as a
part of the rates around it; and the slip that they leave of what rests."""

# --- zero, beside a scale -------------------------------------------------------------

COMPUTED_ZERO = 1e-9
"""What counts as 0 beside 1, beside the largest of its kind, or beside its terms: the
rounding of an eigenvalue, of a mode, of a stiffness, of an equilibrium, of a row or a
rate of a surface, of the energy that an impact gives, of the range of a series that is
constant."""

DEPENDENT_ROWS = 1e-10
"""The singular value of scaled constraint rows, and the eigenvalue of a scaled mass
matrix, against the largest, below which it is zero: rows at an angle of 1e-9 are two
constraints."""

SAFELY_INDEPENDENT = 1e-5
"""Such a value above which it is not zero, known by inverse iteration to 1e-6."""

LOST_RANK = 1e-8
"""Such a value, against its largest on the way, or the length of a relation, against
the longest, below which rank is lost in passing: what would be divided by it is
rounding."""

NEARLY_DEPENDENT_ROWS = 1e-2
"""The smallest singular value of scaled rows below which they are solved by QR: normal
equations square their condition, and lambda loses half of its digits."""

SLIP_AT_REST = 1e-8
"""The slip, as a part of its rates, that relaxation leaves of one that rests."""

SAME_RESULT = 1e-8
"""The difference of two results, against their size, that is none where each has lost
half of its digits: what dependent rows ask for, the entries of a symmetric stiffness,
amplifications of 1 where eigenvalues of a step meet."""

UNCOUPLED = 2.0**-100
"""The norm of what acts back, against that of a matrix, that counts as none."""

# --- stability of methods -------------------------------------------------------------

NEGLIGIBLE_RATE = 1e-2
"""The size of an eigenvalue times the length of a run below which it does nothing."""

ENERGY_CHANGE = 1e-2
"""The change of energy less work within a run, as a part of the energy of the motion,
that is growth or decay in a map of stability."""

BROKEN_CONSTRAINT = 1e-3
"""The residual of a constraint, against its scale, that is no motion on it at all."""

# --- contacts and surfaces of switches ------------------------------------------------

ACCELERATION_ROUNDOFF = 512.0 * UNIT_ROUNDOFF
"""The relative error of an acceleration against all that pushes: terms may cancel."""

SOLUTION_ROUNDOFF = 1e-12
"""What rounding leaves in the solution of a small problem of contacts or of switches,
against its scale: how far past its bounds the share of a side may be, the pivot that
is none, an impulse beside the largest, ratios of a tableau that are tied (order
decides then)."""

DEPENDENT_SQUARE = 1e-14
"""The singular value of a Delassus matrix below which it is zero: it is a square, so
that this is an angle of 1e-7 between rows."""

DEPENDENT_DIRECTIONS = 1e-7
"""The sine of the angle between a direction and the span of others below which it lies
in it: rows of which only the Delassus matrix is known, and brackets of fields."""

TABLEAU_ROUNDOFF = 1e-11
"""What is no pivot in a tableau of entries near 1."""

SOLVED_LAWS = 1e-7
"""The residual of contact laws, against their terms, up to which they are solved."""

LEAST_CLOSING = 1e-10
"""The tolerance below which no contact closes: what a series of impacts leaves where it
is taken to have ended."""
