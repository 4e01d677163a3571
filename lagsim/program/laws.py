"""Kernels of the motion with laws: contacts, friction, limits, each with a mode.

The rows of the laws follow those of the equalities. The rows h that hold satisfy

    M q'' = f + sum_h (A_h^T + sum_s c_s A_s^T) lambda_h + sum_l c_l A_l^T
    A_h q'' = b_h

where a sliding slip s transmits the part c_s of its contact's multiplier, opposite to
its velocity, and a sliding limited row l transmits its bound c_l. Sliding friction
makes the equations unsymmetric; they are small and dense, and are solved by elimination
with pivoting. The rows that hold are independent, which is ensured where modes are set.

If more rows hold than are independent, they share their load with the least norm of all
multipliers within their bounds: the multiplier of a contact or freewheel is not
negative, that of a limited row stays within its limit, and the two of a slip on a disc
(a slip with two directions, which has two rows) stay within the disc whose radius is
the largest friction. The multipliers lambda of the independent rows A_h determine the
constraint forces. Let A be the rows of all laws that share, and P the projection of
their multipliers onto the bounds. The multipliers of least norm with equal forces are
P(A A_h^T y), where the vector y, with an element for each row of A_h, solves

    A_h A^T P(A A_h^T y) = A_h A^T lambda

with the coordinates in units of the rows' elements. This is the condition for the
minimum of a convex function of y, which is found by Newton's method. Multipliers that
bound a friction force are not shared.

Source: F. Pfeiffer and C. Glocker, Multibody Dynamics with Unilateral Contacts, 1996,
chapter 5.
"""

from __future__ import annotations

from math import nan, sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.newton import decompose, solve
from lagsim.methods.parts.parameters import (
    HELD,
    REDUNDANT,
    SLIDING,
    TURNS,
    Parameters,
)
from lagsim.methods.parts.state import of_model
from lagsim.native.kernels.words import bits, external, from_bits
from lagsim.program import mass, nearly_dependent
from lagsim.program.held_rank import note_sigma, own_place
from lagsim.tolerances import OVERFLOW

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

WHOLE = False  # see `mass`; set by the translator


def couple(p: Parameters, sliding: int) -> None:
    """Assemble and factor the matrices S of the systems for multipliers that hold.

    S = Y^T Z, with Y = L^-1 A^T of the rows of one group. Z is L^-1 times the
    generalized force of a unit multiplier of each row, with the friction proportional
    to this multiplier if `sliding` is 1. Each row k of S is scaled by p.scales[k] =
    |Y_k|^-2. Factors are in p.S, their pivots in p.factors. Where S is singular,
    p.scales is nan for the rows of its group.
    """
    n = p.n
    p.u[:] = 0.0
    for k in range(int(p.ranked)):
        i = int(p.order[k])
        row, push = p.Y[k * n :], p.Z[k * n :]
        add_row(p, i, i, 1.0, p.u)
        forward_within(p, i, row)
        place = own_place(p, i)
        if place >= 0:
            p.u[place] = 1.0
            forward_within(p, i, push)
        elif sliding > 0 and has_sliding_friction(p, i):
            add_row(p, i, i, 1.0, p.u)
            slide_along(p, i)
            forward_within(p, i, push)
        else:
            copy_within(p, i, row, push)
        note_column(p, k, i)
    note_still(p)
    p.least_pivot = p.sigma = 1.0
    symmetric = sliding == 0 or no_slip_has_force(p)
    for g in range(int(p.groups)):
        begin, end = bits(p.group_starts[g]), bits(p.group_ends[g])
        couple_group(p, begin, end, g)
        if symmetric:
            note_sigma(p, begin, end, p.S[bits(p.group_matrices[g]) :])
    p.least_sigma = min(p.least_sigma, p.sigma)


def note_column(p: Parameters, k: int, i: int) -> None:
    """Store the column of row i, with place k, if the row has a single column.

    The column's elements of A and Z are stored, too; kernels then need not read these
    matrices for the row. For a row that may reach several columns, -1 is stored.

    k : the place among the rows that hold.
    i : the index of the row.
    """
    n = p.n
    e = mass.first_range(p, i)
    p.only_column[k] = -1.0
    if not WHOLE and mass.first_range(p, i + 1) == e + 1:
        c = mass.range_begin(p, e)
        if mass.range_end(p, e) == c + 1:
            p.only_column[k] = c
            p.only_entry[k] = p.A[i * n + c]
            p.only_force[k] = p.Z[k * n + c]


def note_still(p: Parameters) -> None:
    """Store index, column and element of each held row with a single nonzero element.

    Only rows of laws are stored, see `set_exact_accelerations`.
    """
    first, count = p.m - p.laws, 0
    for k in range(int(p.ranked)):
        i = int(p.order[k])
        row = p.A[i * p.n :]
        elements = 0
        place = 0
        for e in range(mass.first_range(p, i), mass.first_range(p, i + 1)):
            for j in range(mass.range_begin(p, e), mass.range_end(p, e)):
                if row[j] != 0.0:
                    elements += 1
                    place = j
        if i >= first and elements == 1:
            p.still_rows[count] = i
            p.still_columns[count] = place
            p.still_entries[count] = row[place]
            count += 1
    p.stills = count


def couple_group(p: Parameters, begin: int, end: int, g: int) -> None:
    """Assemble and factor S of group g, the rows with places from begin to end - 1.

    S : see `couple`.

    g : the number of the group.
    """
    n, count = p.n, end - begin
    matrix = p.S[bits(p.group_matrices[g]) :]
    for k in range(begin, end):
        i = int(p.order[k])
        row, entries = p.Y[k * n :], matrix[(k - begin) * count :]
        square = product_within(p, i, row, row)
        scale = 1.0 / square if square > 0.0 else 0.0
        p.scales[k] = scale
        if WHOLE:
            for j in range(count):
                entries[j] = product_within(p, i, row, p.Z[j * n :]) * scale
        else:
            entries[:count] = 0.0
            for e in range(bits(p.near_starts[i]), bits(p.near_starts[i + 1])):
                j = bits(p.near_rows[e])
                if p.row_holds[j] > 0.0:
                    place = bits(p.row_place[j])
                    product = product_within(p, i, row, p.Z[place * n :])
                    entries[place - begin] = product * scale
    band = bits(p.group_bands[g])
    regular = decompose(1, count, band, matrix, p.factors[begin:])
    least = 1.0
    for j in range(count):
        least = min(least, abs(matrix[j * count + j]))
    well = regular > 0 and least > SQUARED
    if count > 1 and not well and nearly_dependent.is_frictionless(p, begin, end):
        least = 0.0
        regular = nearly_dependent.factor_rows(p, begin, count, matrix)
        p.factors[begin] = nearly_dependent.BY_ROWS
    if regular == 0:
        p.scales[begin:end] = nan
    p.least_pivot = min(p.least_pivot, least)


# A group of rows whose least pivot of S is smaller is factored by rows, see
# `nearly_dependent`.
SQUARED = 1e-10


def add_row(p: Parameters, i: int, k: int, factor: float, out: Floats) -> None:
    """Add `factor` times row k of A to out (n,), within the reach of row i."""
    for e in range(mass.first_range(p, i), mass.first_range(p, i + 1)):
        j, end = mass.range_begin(p, e), mass.range_end(p, e)
        out[j:end] += factor * p.A[k * p.n + j : k * p.n + end]


def forward_within(p: Parameters, i: int, out: Floats) -> None:
    """Store L^-1 x in `out` (n,), within the reach of row i, and set x to 0.

    x is p.u (n,), whose elements out of that reach are 0.
    """
    n, u = p.n, p.u
    for e in range(mass.first_range(p, i), mass.first_range(p, i + 1)):
        for c in range(mass.range_begin(p, e), mass.range_end(p, e)):
            value = u[c]
            for j in range(mass.first_column(p.inertia_first, c), c):
                value -= p.L[c * n + j] * u[j]
            u[c] = value / p.L[c * n + c]
    for e in range(mass.first_range(p, i), mass.first_range(p, i + 1)):
        c, end = mass.range_begin(p, e), mass.range_end(p, e)
        out[c:end] = u[c:end]
        u[c:end] = 0.0


def copy_within(p: Parameters, i: int, x: Floats, out: Floats) -> None:
    """Copy x (n,) to `out` (n,), within the reach of row i."""
    for e in range(mass.first_range(p, i), mass.first_range(p, i + 1)):
        j, end = mass.range_begin(p, e), mass.range_end(p, e)
        out[j:end] = x[j:end]


def product_within(p: Parameters, i: int, a: Floats, b: Floats) -> float:
    """Return the sum of a_j b_j over the columns j in the reach of row i.

    a, b : (n,).
    """
    found = 0.0
    for e in range(mass.first_range(p, i), mass.first_range(p, i + 1)):
        for j in range(mass.range_begin(p, e), mass.range_end(p, e)):
            found += a[j] * b[j]
    return found


def has_sliding_friction(p: Parameters, i: int) -> bool:
    """Whether a slip of the contact with row i slides, and has friction.

    The slips of a contact follow it in the order of laws.
    """
    own = i - p.m + p.laws
    k = own + 1
    while own >= 0 and k < p.laws and int(p.law_normal[k]) == own:
        if p.law_part[k] != 0.0:
            return True
        k += 1
    return False


def slide_along(p: Parameters, i: int) -> None:
    """Add to p.u (n,) the force of friction for a unit multiplier of row i.

    The force is the sum of c_s A_s^T over the sliding slips s of the contact with row
    i.
    """
    own = i - p.m + p.laws
    k = own + 1
    while k < p.laws and int(p.law_normal[k]) == own:
        if p.law_part[k] != 0.0:
            add_row(p, i, i + k - own, p.law_part[k], p.u)
        k += 1


def add_row_forces(p: Parameters) -> None:
    """Add Z p.w to p.u (n,), L^-1 times the forces of held rows; Z as in `couple`."""
    n = p.n
    for k in range(int(p.ranked)):
        c = int(p.only_column[k])
        if c >= 0:
            p.u[c] += p.w[k] * p.only_force[k]
            continue
        i = int(p.order[k])
        for e in range(mass.first_range(p, i), mass.first_range(p, i + 1)):
            j, end = mass.range_begin(p, e), mass.range_end(p, e)
            p.u[j:end] += p.w[k] * p.Z[k * n + j : k * n + end]


def share_out(p: Parameters) -> None:
    """Store the multiplier of each row, of equalities and laws, in p.multipliers (m,).

    The multipliers of rows that hold are in p.w. A sliding slip transmits its contact's
    multiplier times c, its signed friction coefficient; a sliding limited row transmits
    its bound.
    """
    first = p.m - p.laws
    out = p.multipliers
    p.multipliers[:] = 0.0
    for k in range(int(p.ranked)):
        out[int(p.order[k])] = p.w[k]
    for k in range(p.laws):
        if p.law_part[k] != 0.0:
            out[first + k] = p.law_part[k]
            if p.law_normal[k] >= 0.0:
                out[first + k] *= out[first + int(p.law_normal[k])]


def solve_rows(p: Parameters, sliding: int) -> None:
    """Solve S x = p.w in place, group by group; x is nan where S is singular.

    S, sliding : see `couple`, which is called if the factors are not known.
    """
    if p.factored < 2.0:
        couple(p, sliding)
        p.factored = p.lasting
    for k in range(int(p.ranked)):
        p.w[k] *= p.scales[k]
    for g in range(int(p.groups)):
        begin = bits(p.group_starts[g])
        if p.scales[begin] < OVERFLOW:  # otherwise not a number
            count = bits(p.group_ends[g]) - begin
            S, band = p.S[bits(p.group_matrices[g]) :], bits(p.group_bands[g])
            if count == 1:
                p.w[begin] /= S[0]
            elif p.factors[begin] == nearly_dependent.BY_ROWS:
                nearly_dependent.solve_by_rows(p, begin, count, S)
            else:
                solve(1, count, band, S, p.factors[begin:], p.w[begin:])


def solve_in_place(count: int, band: int, S: Floats, pivots: Floats, x: Floats) -> None:
    """Replace x (count,) by S^-1 x; nan where S is singular.

    band, pivots : as for `methods.parts.newton.decompose`.
    """
    if decompose(1, count, band, S, pivots) == 0:
        x[:count] = nan
    else:
        solve(1, count, band, S, pivots, x)


# Greatest number of Newton steps for the shares, and of halvings of a step; the part of
# the largest diagonal element that keeps the matrix regular where all shares are at
# their bounds.
SHARING, HALVED, REGULAR = 60, 40, 1e-13
# A step is accepted if the function falls by this part of its slope; relative residuals
# of the forces at which the iteration stops, and up to which shares are accepted.
FALLS, SETTLED, SHARED = 1e-4, 4e-16, 1e-10


def share_loads(_t: float, _y: Floats, p: Parameters, out: Floats) -> None:
    """Replace multipliers of dependent rows in out (m,) by those of least norm.

    The multipliers are unchanged if the iteration does not converge. The multipliers of
    least norm are for output rows only, not for the event functions that end modes:
    they are not linear in the forces, so that they cannot be combined along surfaces,
    and one that has reached its bound stays there.
    """
    lam = out[p.m - p.laws :]
    p.factored = min(p.factored, 1.0)  # S is overwritten
    count = products(p)
    forces, y, step = p.diagonal, p.w, p.share_step
    for i in range(count):
        forces[i] = 0.0
        y[i] = 0.0
        for k in range(p.laws):
            forces[i] += p.free[i * p.laws + k] * lam[k]
    value = share_by(p, count, y)
    left = unshared(p, count)
    for _ in range(SHARING):
        if left <= SETTLED:
            break
        slope = newton_step(p, count)
        part = 1.0
        for _ in range(HALVED):
            p.share_next[:count] = y[:count] + part * step[:count]
            found = share_by(p, count, p.share_next)
            fewer = unshared(p, count)
            # Near the minimum, differences of the function are rounding, of slopes not.
            if found <= value - FALLS * part * slope or fewer <= 0.5 * left:
                break
            part *= 0.5
        y[:count] = p.share_next[:count]
        value = share_by(p, count, y)
        left = unshared(p, count)
    if left <= SHARED:
        for k in range(p.laws):
            if shares(p, k):
                lam[k] = p.share_found[k]


def products(p: Parameters) -> int:
    """Store G = A_h A^T (count, laws) in p.free; return count.

    A has the rows of all laws, A_h the `count` rows of the laws that hold and take part
    in the distribution of multipliers (see `shares`). The product is weighted, see
    `inner`.
    """
    n, laws = p.n, p.laws
    rows = p.A[(p.m - laws) * n :]
    count = 0
    store_weights(p)
    for k in range(laws):
        if p.law_mode[k] == HELD and shares(p, k):
            for i in range(laws):
                p.free[count * laws + i] = 0.0
                if shares(p, i):
                    p.free[count * laws + i] = inner(p, rows[k * n :], rows[i * n :])
            count += 1
    return count


def share_by(p: Parameters, count: int, y: Floats) -> float:
    """Compute multipliers within their bounds in p.share_found (laws,).

    The multipliers are P(sum_i y_i g_i): the projection onto the bounds of a
    combination of the `count` rows g_i stored in p.free, with the factors y (count,).
    Return the value of the convex function of y whose minimum is the solution.
    """
    laws = p.laws
    found = 0.0
    for k in range(laws):
        p.share_target[k] = 0.0
        for i in range(count):
            p.share_target[k] += y[i] * p.free[i * laws + k]
    for k in range(laws):
        p.share_found[k] = p.share_target[k] * projection_factor(p, k)
        found += (p.share_target[k] - 0.5 * p.share_found[k]) * p.share_found[k]
    for i in range(count):
        found -= p.diagonal[i] * y[i]
    return found


def projection_factor(p: Parameters, k: int) -> float:
    """Return the factor by which the projection P onto the bounds scales multiplier k.

    The factor is 1 within the bounds; 0 for a negative multiplier of a one-sided law;
    else bound over size.
    """
    if is_one_sided(p, k):
        return 1.0 if p.share_target[k] > 0.0 else 0.0
    size = unprojected_size(p, k)
    return 1.0 if size <= p.law_statics[k] else float(p.law_statics[k] / size)


def unprojected_size(p: Parameters, k: int) -> float:
    """Return the size of multiplier k of a limited row before the projection P.

    For a slip on a disc it is the norm of the multipliers of both rows.
    """
    x = p.share_target[k]
    z = p.share_target[int(p.law_pair[k])] if p.law_pair[k] >= 0.0 else 0.0
    return sqrt(x * x + z * z)


def unshared(p: Parameters, count: int) -> float:
    """Store the gradient (count,) of the function of `share_by` in p.share_gradient.

    The gradient is A_h A^T P(...) less A_h A^T lambda: the forces that the bounded
    multipliers lack. Return its largest component relative to the sizes of its terms.
    """
    laws = p.laws
    most = 0.0
    for i in range(count):
        row = p.free[i * laws :]
        missed = -p.diagonal[i]
        size = abs(p.diagonal[i])
        for k in range(laws):
            missed += row[k] * p.share_found[k]
            size += abs(row[k] * p.share_found[k])
        p.share_gradient[i] = missed
        if size > 0.0:
            most = max(most, abs(missed) / size)
    return most


def newton_step(p: Parameters, count: int) -> float:
    """Store Newton's step (count,) to the minimum of `share_by` in p.share_step.

    Return the derivative of the function along the step, with the sign reversed.
    """
    laws = p.laws
    change = p.share_next
    size = 0.0
    for i in range(count):
        row = p.free[i * laws :]
        for k in range(laws):
            change[k] = share_slope(p, k, row)
        for j in range(count):
            p.S[i * count + j] = mass.product(laws, change, p.free[j * laws :])
        size = max(size, mass.product(laws, row, row))
    for i in range(count):
        p.S[i * count + i] += REGULAR * size
        p.share_step[i] = -p.share_gradient[i]
    solve_in_place(count, count, p.S, p.factors, p.share_step)
    return -mass.product(count, p.share_gradient, p.share_step)


def share_slope(p: Parameters, k: int, change: Floats) -> float:
    """Return the change of multiplier k after the projection P, to first order.

    change : ndarray, shape (laws,)
        Change of the multipliers before the projection.
    """
    part = projection_factor(p, k)
    found = part * change[k]
    if is_one_sided(p, k) or part == 1.0:
        return float(found)
    size = unprojected_size(p, k)
    along = p.share_target[k] * change[k]
    if p.law_pair[k] >= 0.0:
        other = int(p.law_pair[k])
        along += p.share_target[other] * change[other]
    return float(found - part * p.share_target[k] * along / (size * size))


def store_weights(p: Parameters) -> None:
    """Store in p.u (n,) the weights of the inner product `inner`.

    The weight of coordinate j is 1 / a^2, with a the largest |A_ij| of the laws that
    share.
    """
    n = p.n
    first = p.m - p.laws
    weights = p.u
    p.u[:] = 0.0
    for k in range(p.laws):
        if shares(p, k):
            for j in range(n):
                weights[j] = max(weights[j], abs(p.A[(first + k) * n + j]))
    for j in range(n):
        if weights[j] > 0.0:
            weights[j] = 1.0 / (weights[j] * weights[j])


def inner(p: Parameters, a: Floats, b: Floats) -> float:
    """Return sum_j p.u_j a_j b_j, the weighted inner product of two rows (n,)."""
    found = 0.0
    for j in range(p.n):
        found += p.u[j] * a[j] * b[j]
    return found


def shares(p: Parameters, k: int) -> bool:
    """Whether law k takes part in the least-norm distribution of multipliers.

    A law does if it holds or is redundant, and its multiplier bounds no friction. The
    row of a redundant law has to be a combination of rows of other laws: where an
    equality, or a surface that the motion follows, is needed as well, the multipliers
    of laws alone do not determine its share.
    """
    redundant = p.law_mode[k] == REDUNDANT and p.law_shared[k] > 0.0
    if not (p.law_mode[k] == HELD or redundant):
        return False
    if is_bounded(p, k):
        return float(p.law_normal[k]) < 0.0 and float(p.law_place[k]) < 0.0
    slips = 0
    for i in range(p.laws):
        if int(p.law_normal[i]) == k:
            slips += 1
    return is_one_sided(p, k) and slips == 0


# Event function of a mode that has no end of its own.
ENDLESS = 1.0
# A slip on a disc has begun when its speed is this multiple of its floor.
BEGUN = 16.0
# Cosine of the angle by which its direction turns before it is stored anew; a slip that
# turns by more than a right angle in a step has stopped.
TURNED = 0.5


# Of each law (laws,): its gap, else its speed; of a slider its event function `left`.
gaps = of_model("gaps")


@external
def solve_motion(t: float, y: Floats, p: Parameters) -> None:
    """Store q'' (n,) and lambda (m,) in p.motion, see `dense`."""


def clear_open_rows(p: Parameters) -> None:
    """Set the rows in p.A of laws that do not hold to 0."""
    first = p.m - p.laws
    for k in range(p.laws):
        if p.law_mode[k] != HELD:
            p.A[(first + k) * p.n : (first + k + 1) * p.n] = 0.0


def correct(p: Parameters) -> None:
    """Store in p.u (n,) the Newton step of positions or velocities, multiplied by L^T.

    The step makes the residuals of the rows that hold 0 to first order; on entry p.w
    holds minus these residuals.
    """
    solve_rows(p, 0)
    p.u[:] = 0.0
    add_row_forces(p)


def factor_held(p: Parameters) -> None:
    """Factor M, and store the indices of the rows that hold in p.order, by groups.

    p.ranked is their number. If the same rows hold as at the last call, their groups
    are kept, and so are factors of S (see `couple`) where M, A and the friction are
    constant.
    """
    first = p.m - p.laws
    changed = 0
    for k in range(p.m):
        holds = p.aside[k] == 0.0 if k < first else p.law_mode[k - first] == HELD
        value = 1.0 if holds else 0.0
        if p.row_holds[k] != value:
            p.row_holds[k] = value
            changed = 1
    if changed > 0:
        group_rows(p)
        p.Z[:] = 0.0  # and stays 0 outside of the reach
    p.lasting = p.constant if no_slip_has_force(p) else min(p.constant, 1.0)
    if changed > 0 or p.lasting < 2.0:
        p.factored = min(p.factored, 1.0)
    if p.factored < 1.0:
        mass.factor(p)


def no_slip_has_force(p: Parameters) -> bool:
    """Whether no multiplier of a contact causes friction."""
    for k in range(p.laws):
        slides = p.law_mode[k] == SLIDING or p.law_mode[k] == REDUNDANT
        if slides and p.law_normal[k] >= 0.0:
            return False
    return True


def group_rows(p: Parameters) -> None:
    """Store the groups of rows that hold, as row numbers and bounds of the groups.

    Two rows are in one group if their reaches (columns of the coordinates on which they
    act) overlap, directly or through further rows. The rows of a group are ascending in
    p.order, as are the groups by their first rows.
    """
    groups = 0
    begin = 0
    matrix = 0
    p.row_group[:] = -1.0
    for k in range(p.m):
        if p.row_holds[k] > 0.0 and p.row_group[k] < 0.0:
            size = join_group(p, k, groups)
            p.group_starts[groups] = from_bits(begin)
            p.group_ends[groups] = from_bits(begin)  # advanced by each row below
            p.group_matrices[groups] = from_bits(matrix)
            p.group_bands[groups] = from_bits(0)
            begin += size
            matrix += size * size
            groups += 1
    p.groups = groups
    p.ranked = begin
    for k in range(p.m):
        if p.row_holds[k] > 0.0:
            g = int(p.row_group[k])
            place = bits(p.group_ends[g])
            p.row_place[k] = from_bits(place)
            p.order[place] = k
            p.group_ends[g] = from_bits(place + 1)
    for k in range(int(p.ranked)):
        widen_band(p, k)


def join_group(p: Parameters, first: int, number: int) -> int:
    """Assign group `number` to all rows that hold and are coupled with row `first`.

    Return the count of these rows.
    """
    queue = p.x
    p.row_group[first] = number
    queue[0] = first
    done = 0
    count = 1
    while done < count:
        i = int(queue[done])
        done += 1
        for e in range(bits(p.near_starts[i]), bits(p.near_starts[i + 1])):
            j = bits(p.near_rows[e])
            if p.row_holds[j] > 0.0 and p.row_group[j] < 0.0:
                p.row_group[j] = number
                queue[count] = j
                count += 1
    return count


def widen_band(p: Parameters, k: int) -> None:
    """Widen the matrix band of the group of row k to hold row k and its neighbours.

    Rows are neighbours if their reaches overlap.

    k : the place of a row of the group.
    """
    i = int(p.order[k])
    g = int(p.row_group[i])
    for e in range(bits(p.near_starts[i]), bits(p.near_starts[i + 1])):
        j = bits(p.near_rows[e])
        if p.row_holds[j] > 0.0:
            far = bits(p.row_place[j]) - k  # row j has row i as a neighbour, too
            p.group_bands[g] = from_bits(max(bits(p.group_bands[g]), far))


def elapsed_part(t: float, p: Parameters, k: int) -> float:
    """Return (t - t0) / T for slip k, whose transition begins at t0 and lasts T.

    The transition is the regularized beginning of the slip.
    """
    return float((t - p.law_begun[k]) / p.law_lasts[k])


def way(t: float, p: Parameters, k: int) -> float:
    """Return component k of the direction of a slip on a disc during its transition.

    k is the law of one of the slip's two rows. The result is the component at the
    beginning plus a polynomial in `elapsed_part`.
    """
    x = elapsed_part(t, p, k)
    turn = 0.0
    for j in range(TURNS):
        turn = (turn + p.law_turn[(k + 1) * TURNS - 1 - j]) * x
    return float(p.law_direction[k] + turn)


def store_sliding_forces(t: float, p: Parameters) -> None:
    """Store the coefficients c of sliding rows in p.law_part (laws,).

    c is the friction coefficient with the sign that opposes the slip, or the limit of a
    limited row, whose force c A^T is added to f.
    """
    first = p.m - p.laws
    direction, part = p.law_direction, p.law_part
    for k in range(p.laws):
        part[k] = 0.0
        if p.law_mode[k] == REDUNDANT:
            # For a row with a direction: at its bound, held there by the other rows.
            part[k] = direction[k] * p.law_statics[k]
        if p.law_mode[k] == SLIDING:
            part[k] = direction[k] * p.law_bounds[k]
            other = int(p.law_pair[k])
            if other >= 0:
                x = p.law_speeds[k]
                z = p.law_speeds[other]
                if p.law_floor[k] > 0.0:
                    x -= p.law_floor[k] * way(t, p, k)
                    z -= p.law_floor[k] * way(t, p, other)
                speed = sqrt(x * x + z * z)
                if speed > 0.0:
                    part[k] = -p.law_bounds[k] * x / speed
                if x * direction[k] + z * direction[other] > 0.0:
                    # Beyond its stop, in a step that an event will shorten: as before.
                    part[k] = -part[k]
        if part[k] != 0.0 and p.law_normal[k] < 0.0:
            add_row(p, first + k, first + k, part[k], p.f)


def respond(p: Parameters) -> None:
    """Solve for q'' and lambda with p.terms and the coefficients in p.law_part."""
    mass.free_motion(p)
    known = p.factored >= 2.0  # and the elements of rows with one column are known
    for k in range(int(p.ranked)):
        i, c = int(p.order[k]), int(p.only_column[k])
        if known and c >= 0:
            p.w[k] = p.b[i] - p.only_entry[k] * p.motion[c]
        else:
            p.w[k] = mass.missing(p, i)
    solve_rows(p, 1)
    p.u[:] = p.v
    add_row_forces(p)
    mass.backward_mass(p, p.u, p.motion)
    set_exact_accelerations(p)
    if p.least_pivot < REFINED:
        refine(p)
    share_out(p)


# A solution is refined where a pivot of S, whose diagonal is 1, is smaller: S has the
# square of the condition of the rows. It is refined until the multipliers change by no
# more than this part, at most so often.
REFINED, UNCHANGED, REFINEMENTS = 1e-3, 1e-14, 12


def refine(p: Parameters) -> None:
    """Refine q'' and the multipliers in p.w iteratively, by the residuals b - A q''.

    The residuals are small, and so are the errors of the corrections: q'' is accurate
    although the condition number of S (see `couple`) is the square of that of the rows.
    """
    count, found = int(p.ranked), p.diagonal
    found[:count] = p.w[:count]
    for _ in range(REFINEMENTS):
        for k in range(count):
            p.w[k] = mass.missing(p, int(p.order[k]))
        solve_rows(p, 1)
        p.u[:] = 0.0
        add_row_forces(p)
        mass.backward_mass(p, p.u, p.v)
        p.motion[: p.n] += p.v[: p.n]
        set_exact_accelerations(p)
        change = 0.0
        size = 0.0
        for k in range(count):
            change = max(change, abs(p.w[k]))
            found[k] += p.w[k]
            size = max(size, abs(found[k]))
        if not change > UNCHANGED * size:  # or not a number
            break
    p.w[:count] = found[:count]


def set_exact_accelerations(p: Parameters) -> None:
    """Set q'' of each coordinate that a single law's row determines to the exact b / A.

    By the rounding of the solution the coordinate would pass a switch at which it
    rests. A q'' that is not finite is unchanged: its multiplier is out of the range of
    doubles.
    """
    for k in range(int(p.stills)):
        place = int(p.still_columns[k])
        if abs(p.motion[place]) < OVERFLOW:
            p.motion[place] = p.b[int(p.still_rows[k])] / p.still_entries[k]


def law_event_functions(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store each law's event function (laws,): negative past the end of its mode."""
    mode = p.law_mode
    if p.law_forces > 0.0:
        solve_motion(t, y, p)
        if p.sliding > 0.0:  # otherwise on the lower sides of followed surfaces
            p.multipliers[:] = p.side_fields[p.size : p.size + p.m]
    gaps(t, y, p, out)
    for k in range(p.laws):
        if p.law_place[k] >= 0.0:  # a slider
            continue
        if mode[k] == HELD:
            out[k] = hold_margin(p, k)
            if p.law_weakens[k] > 0.0:  # ends where static < sliding
                out[k] = min(out[k], p.law_statics[k] - p.law_bounds[k])
        elif mode[k] == SLIDING:
            out[k] = slide_margin(t, p, k, out[k])
            if p.law_varies[k] > 0.0:  # it may not become negative
                out[k] = min(out[k], p.law_bounds[k])
        elif mode[k] == REDUNDANT or not is_one_sided(p, k):
            out[k] = ENDLESS


def is_one_sided(p: Parameters, k: int) -> bool:
    """Whether the multiplier of law k cannot be negative."""
    return float(p.law_low[k]) == 0.0


def is_bounded(p: Parameters, k: int) -> bool:
    """Whether the multiplier of law k has an upper and a lower bound."""
    return float(p.law_high[k]) < OVERFLOW


def hold_margin(p: Parameters, k: int) -> float:
    """Return the event function of held law k, the margin of lambda to its bound."""
    if is_one_sided(p, k):
        return float(p.multipliers[p.m - p.laws + k])
    return sticking_margin(p, k) if is_bounded(p, k) else ENDLESS


def slide_margin(t: float, p: Parameters, k: int, speed: float) -> float:
    """Return the event function of sliding law k: its speed in the sliding direction.

    For a slip on a disc it is stored for the first row, and also ends the mode where
    the slip has turned by more than the angle with the cosine `TURNED`. In the slip's
    transition it is the least of the margin to the final speed, the time that is left,
    and the speed in the initial direction.

    speed : the rate of the row, signed.
    """
    direction = p.law_direction
    other = int(p.law_pair[k])
    if other < 0:
        return float(-direction[k] * speed)
    if other < k:
        return ENDLESS
    x = p.law_speeds[k]
    z = p.law_speeds[other]
    speed = sqrt(x * x + z * z)
    ahead = -(direction[k] * x + direction[other] * z)
    if p.law_floor[k] > 0.0:
        left = BEGUN * p.law_floor[k]
        # The band ends the mode, half a floor, before the end of the polynomial's
        # range.
        in_time = left * (1.0 - elapsed_part(t, p, k)) - 0.5 * p.law_floor[k]
        return float(min(left - speed, in_time, ahead))
    if ahead < 0.0:
        return float(-speed)
    return float(min(speed - p.law_still[k], ahead - TURNED * speed))


def sticking_margin(p: Parameters, k: int) -> float:
    """Return the event function of sticking law k: its bound less |lambda|.

    For a slip on a disc it is stored for the first row that holds.
    """
    first = p.m - p.laws
    lam = p.multipliers
    other = int(p.law_pair[k])
    bound = p.law_statics[k]
    if p.law_normal[k] >= 0.0:
        bound *= lam[first + int(p.law_normal[k])]
    if other < 0:
        return float(bound - abs(lam[first + k]))
    if other < k and p.law_mode[other] == HELD:
        return ENDLESS
    x = lam[first + k]
    z = lam[first + other]
    return float(bound - sqrt(x * x + z * z))
