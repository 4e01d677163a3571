"""Tolerances: constants that decide that a number is zero, equal, small or done.

Each is defined here once, with its meaning. Where rounding decides, the value is a
multiple of the unit roundoff; where an error of a method or of a solve decides, it is a
share of the scale that its docstring names. Budgets (how many, how long, how large a
file) stand in `limits`; coefficients, safety factors and step ratios of a method in its
file. Kernels read these like any global of their module: they are constants when
compiled.
"""

from __future__ import annotations

# --- floating-point numbers -----------------------------------------------------------

UNIT_ROUNDOFF = 2.0**-53
"""The largest relative error of one operation in double precision."""

OVERFLOW = 1e300
"""Magnitude from which on a number counts as not finite: results may overflow."""

UNDERFLOW = 2.0**-1068
"""Magnitude below which a number has no significant digits (a few subnormal steps)."""

TINY = 1e-300
"""Lower bound of divisors and of arguments of logarithms, which excludes 0."""

SHORTEST_RUN = 1e-290
"""Length of a run below which doubles cannot separate its rows and its steps."""

SQUARABLE = 1e140
"""Magnitude up to which squares, and sums of a few squares, are finite."""

# --- rounding -------------------------------------------------------------------------

STATE_ROUNDOFF = 4.0 * UNIT_ROUNDOFF
"""Relative error of a component of the state: a few roundings. No tolerance is smaller,
and a matrix entry below the effect of this change is zero."""

TERM_ROUNDOFF = 8.0 * UNIT_ROUNDOFF
"""Relative error of a few operations: numbers that differ by less are equal, and a
residual below this share of its terms is rounding."""

TIME_ROUNDOFF = 16.0 * UNIT_ROUNDOFF
"""The shortest step, as a part of t: below it a step makes no progress."""

TIGHTEST_RTOL = 1e-14
"""Smallest meaningful relative tolerance of a step."""

RESIDUAL_ROUNDOFF = 64.0 * UNIT_ROUNDOFF
"""The residual of a constraint after a Newton step, as a part of its terms."""

SURFACE_ROUNDOFF = 512.0 * UNIT_ROUNDOFF
"""Distance of a state from a surface due to rounding, as a share of the state's
size."""

VALUE_ROUNDOFF = 32.0 * UNIT_ROUNDOFF
"""The relative error of a rate, or of a column that was computed from others of its
size."""

SUM_ROUNDOFF = 128.0 * UNIT_ROUNDOFF
"""Rounding of a sum of many terms, as a share of the terms: of forces in balance, and
of the change of a coordinate against its values or against the motion of coupled
coordinates (a Newton step onto constraints, the range of a coordinate at rest)."""

DOUBLE_ROOT = 2.0**-26
"""Relative error of a value that is found as a double root: half of the digits."""

PROBE = 2.0**-36
"""Relative change of a state for measuring the effect of rounding on y': large enough
that the difference has digits, small enough that the response is linear."""

CLEAR_OF_ROUNDING = 16.0
"""Factor by which a value exceeds its rounding if it counts as nonzero: the distance
from a surface that has been left, the height of a flight, the jump of a rate."""

SAME_TIME = 8.0
"""Error of a located time in units in the last place: functions of time do not change
within it."""

SAME_INSTANT = 2.0**-50
"""Difference of two times, as a share of the larger of these times and the start, up to
which they are one instant: 4 units in the last place."""

# --- rows of a run --------------------------------------------------------------------

SAME_ROW = 1e-6
"""Difference of times of rows, as a share of their spacing or of the run, up to which
they are equal: an event is located to the tolerance of the run."""

ZERO_BESIDE = 1e-14
"""Magnitude of a column, relative to other columns of its unit, up to which it is
zero."""

PLACE_BESIDE = 1e-12
"""Uncertainty of a position, as a share of the motion of coupled coordinates."""

NO_MOTION = 1e-6
"""Motion of a coordinate, as a share of the motion of coupled coordinates, below which
it counts as no motion."""

SATISFIED = 1e-6
"""Residual of a constraint, as a share of its scale, up to which it is satisfied in
rows, at the start, or where it comes into force; and of an equilibrium, as a share of
the forces. Steps leave only rounding, a millionth of this; starts that are typed have
six digits."""

ENERGY_DRIFT = 1e-6
"""Drift of the energy, as a share of the energy in play, that is reported: the default
tolerance leaves 1e-9."""

ENERGY_ROUNDOFF = 1e-13
"""Rounding of an energy, as a share of its magnitude, between neighbouring rows."""

SAME_ENERGY = 1e-10
"""Relative difference between the sum of shares of the energy and the whole, up to
which they are equal."""

# --- iterations -----------------------------------------------------------------------

CONVERGED = 1e-12
"""Relative accuracy of Newton's method: of a residual against its terms, of a step
against the values, of a gradient against its change. Also the error of a rate, as a
share of the motion, due to numbers that were computed elsewhere."""

STALLED_STEP = 1e-9
"""Newton step, as a share of the state, at which an implicit method accepts that its
steps stop decreasing."""

SAME_STEP = 1e-9
"""Difference of steps or times, as a share of a step, up to which they are equal."""

HALF_OF_DIGITS = 1e-6
"""Accuracy of solutions that are known to half of the digits, relative to 1 or their
scale: roots, shares, directions, eigenvalues and jumps that differ by less are equal,
or zero. Rounding separates a double zero of a spectrum by the root of its size."""

LEAST_PIVOT = 1e-13
"""Smallest pivot, or inertia at a passage, as a share of its terms: three correct
digits remain, which is enough for iterations."""

SETTLED_IMPULSE = 1e-10
"""Change of its own rate by an impulse, as a share of the neighbouring rates, at which
iterations for impulses end; and the remaining slip of a contact at rest."""

# --- zero, beside a scale -------------------------------------------------------------

COMPUTED_ZERO = 1e-9
"""Magnitude that counts as 0 relative to 1, to the largest of its kind, or to its
terms: of an eigenvalue, a mode, a stiffness, an equilibrium, a row or a rate of a
surface, the energy gained at an impact, the range of a series that is constant."""

DEPENDENT_ROWS = 1e-10
"""Singular value of scaled constraint rows, or eigenvalue of a scaled mass matrix,
relative to the largest, below which it is zero: rows at an angle of 1e-9 are two
constraints."""

SAFELY_INDEPENDENT = 1e-5
"""Singular value of scaled rows above which it is nonzero, known by inverse iteration
to 1e-6."""

LOST_RANK = 1e-8
"""Singular value, relative to the largest along the motion, or length of a relation,
relative to the longest, below which rank is lost at a passage: a quotient by it is
rounding."""

NEARLY_DEPENDENT_ROWS = 1e-2
"""Smallest singular value of scaled rows below which they are solved by QR: normal
equations square the condition number, and lambda loses half of its digits."""

SLIP_AT_REST = 1e-8
"""Slip, as a share of its rates, that relaxation leaves at a contact at rest."""

SAME_RESULT = 1e-8
"""Relative difference of two results that have lost half of their digits, up to which
they are equal: multipliers of dependent rows, entries of a symmetric stiffness,
amplifications of 1 at double eigenvalues."""

# --- stability of methods -------------------------------------------------------------

NEGLIGIBLE_RATE = 1e-2
"""Magnitude of an eigenvalue times the length of a run, below which it has no
effect."""

ENERGY_CHANGE = 1e-2
"""Change of energy - work during a run, as a share of the energy of the motion, that
counts as growth or decay in a stability map."""

BROKEN_CONSTRAINT = 1e-3
"""Residual of a constraint, as a share of its scale, above which the motion has left
it."""

# --- contacts and surfaces of switches ------------------------------------------------

ACCELERATION_ROUNDOFF = 512.0 * UNIT_ROUNDOFF
"""Relative error of an acceleration, as a share of all forces: terms may cancel."""

SOLUTION_ROUNDOFF = 1e-12
"""Rounding in the solution of a small problem of contacts or switches, relative to its
scale: of the share of a side beyond its bounds, of a pivot that is zero, of an impulse
beside the largest, of tied ratios of a tableau (order decides then)."""

DEPENDENT_SQUARE = 1e-14
"""Singular value of a Delassus matrix below which it is zero: it is a square, so this
is an angle of 1e-7 between rows."""

DEPENDENT_DIRECTIONS = 1e-7
"""Sine of the angle between a direction and the span of others below which it lies in
the span: for rows known only by their Delassus matrix, and for Lie brackets."""

TABLEAU_ROUNDOFF = 1e-11
"""Largest magnitude that is no pivot in a tableau of entries near 1."""

SOLVED_LAWS = 1e-7
"""Residual of contact laws, as a share of their terms, up to which they are solved."""

LEAST_CLOSING = 1e-10
"""Smallest tolerance for the closing of a contact: the gap that remains where a series
of impacts is ended."""
