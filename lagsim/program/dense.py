"""Numerical solution of the equations of motion by loops over dense matrices.

    [ M  A^T ] [  q''    ]   [ f ]
    [ A   0  ] [ -lambda ] = [ b ]

For many coordinates, and for rows that are dependent or nearly so. M = L L^T; the
columns of Y = L^-1 A^T are scaled to length 1, and Y = Q R is factored by Householder
reflections with column pivoting, which is accurate for nearly parallel rows (S = Y^T Y
would square the condition number). Rows that are redundant in every state are set
aside: at the stages of a step, off the constraints, they are not exactly redundant, and
the choice of the omitted row must not change from stage to stage. lambda is the
solution of least norm over all rows, and A^T lambda is unique. M, or its replacement
where M is singular, is factored in `mass`. With LAWS, systems in which some rows hold
at times only are solved in `laws`.

The derivative of the accelerations with respect to the state is exact. For the
residuals r = M q'' - f - A^T lambda and s = A q'' - b, with q'' and lambda as
independent variables, d(q'', lambda)/dy solves the equations of motion with -dr/dy for
f and -ds/dy for b, so that one factorisation serves all columns. dr/dy and ds/dy are
evaluated from the graph. lambda is then that of the rows chosen by the pivoting.

The array p.Y (m, n) holds Y^T: its row i is L^-1 A_i, scaled.

Sources: G. H. Golub and C. F. Van Loan, Matrix Computations, 4th ed., sections 5.2,
5.4 and 5.5.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.parameters import NOTE, Parameters
from lagsim.methods.parts.state import columns, of_model
from lagsim.program import mass
from lagsim.program.held_rank import (
    note_held_directions,
    own_place,
    update_held_lengths,
)
from lagsim.program.laws import (
    clear_open_rows,
    correct,
    factor_held,
    respond,
    store_sliding_forces,
)
from lagsim.tolerances import DEPENDENT_ROWS, LOST_RANK

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

LAWS = False  # set by the translator


def store_scaled_rows(p: Parameters) -> None:
    """Compute the scaled rows L^-1 A_i in p.Y (m, n), and the scales in p.scales (m,).

    A row is scaled by the largest length that the row has had in the arc, so that a
    vanishing row is detected; see `update_lengths`.
    """
    n = p.n
    for i in range(p.m):
        row = p.Y[i * n :]
        row[:n] = p.A[i * n : (i + 1) * n]
        mass.forward_mass(p, row)
        length = max(p.lengths[i], sqrt(mass.product(n, row, row)))
        p.scales[i] = 1.0 / length if length > 0.0 else 0.0
        row[:n] *= p.scales[i]


def update_lengths(p: Parameters) -> None:
    """Update p.lengths (m,), the largest length |L^-1 A_i| of each row in the arc.

    Called at accepted states only: stages and rejected states may lie anywhere.
    """
    for k in range(p.m):
        i = int(p.order[k])
        if p.scales[k] > 0.0:
            p.lengths[i] = max(p.lengths[i], 1.0 / p.scales[k])


def reflect(p: Parameters) -> int:
    """Factor Y = Q R by Householder reflections with pivoting; return the rank.

    The generic rank, p.expected, is that in almost every state. Pivots beyond it count
    as zero: at the stages of a step, off the constraints, dependent rows are not
    exactly dependent.

    On return p.sigma is the size of the last generically independent column. Row k of
    p.Y holds R[0:k, k], followed by the vector of the k-th reflection without its first
    component, which is 1; R[k, k] is p.diagonal[k]. A row is reflected onto its largest
    element, which is exchanged into column k and noted in p.places, so that rounding
    errors stay among the coordinates that rows couple.
    """
    n, Y, diagonal, places = p.n, p.Y, p.diagonal, p.places
    kept = set_aside(p)
    for k in range(n):
        places[k] = k
    cutoff = max(DEPENDENT_ROWS, LOST_RANK * p.reference)
    expected = min(n, kept, int(p.expected))
    p.sigma = 1.0
    rank = expected
    reflected = 0
    for k in range(expected):
        best = longest_row(n, k, kept, Y)
        longest = sqrt(rest_of_row(n, k, Y[best * n :]))
        p.sigma = longest
        if longest < cutoff:
            rank = min(rank, k)
        if longest == 0.0:
            break
        swap(p, k, best)
        row = Y[k * n :]
        places[k] = largest_entry(n, k, row)
        exchange(n, p.m, k, int(places[k]), Y)
        diagonal[k] = -longest
        if row[k] < 0.0:
            diagonal[k] = longest
        head = row[k] - diagonal[k]
        p.factors[k] = -head / diagonal[k]
        row[k + 1 : n] /= head
        for i in range(k + 1, p.m):
            mirror(n, k, row, p.factors[k], Y[i * n :])
        reflected = k + 1
    if p.least_sigma >= NOTE:
        note_directions(p, reflected)
    p.least_sigma = min(p.least_sigma, p.sigma)
    return rank


def note_directions(p: Parameters, end: int) -> None:
    """Store the directions z of the first `end` reflections in p.directions (end, n).

    The directions are orthonormal in the metric of M and span the vectors M^-1 A_i of
    the first `end` pivot rows. p.momenta (end, n) holds M z.
    """
    n, u = p.n, p.mirrored
    p.noted = end
    for k in range(end):
        u[:n] = 0.0
        u[k] = 1.0
        for before in range(k + 1):
            j = k - before
            mirror(n, j, p.Y[j * n :], p.factors[j], u)
        from_places(n, p.places, u)
        mass.store_direction(p, k, u)


def longest_row(n: int, k: int, end: int, Y: Floats) -> int:
    """Return the index i, k <= i < end, of the row of Y with the largest norm.

    The norm is that of the elements Y_ij with j >= k; Y has n columns.
    """
    best = k
    longest = -1.0
    for i in range(k, end):
        length = rest_of_row(n, k, Y[i * n :])
        if length > longest:
            longest = length
            best = i
    return best


def set_aside(p: Parameters) -> int:
    """Exchange the rows of Y so that rows marked in p.aside (m,) come last.

    Return the number of rows that are not marked.
    """
    m = p.m
    kept = m
    for back in range(m):
        i = m - 1 - back
        p.order[i] = i
        if p.aside[i] > 0.0:
            kept -= 1
    end = m
    for back in range(m):
        i = m - 1 - back
        if p.aside[i] > 0.0:
            end -= 1
            swap(p, i, end)
    return kept


def rest_of_row(n: int, k: int, row: Floats) -> float:
    """Return the sum of row[j]^2 over k <= j < n."""
    return mass.product(n - k, row[k:], row[k:])


def swap(p: Parameters, k: int, i: int) -> None:
    """Exchange rows k and i of Y, with their scales, right sides and indices.

    k, i : places in the present order of pivots.
    """
    n, Y, scales, right, order = p.n, p.Y, p.scales, p.w, p.order
    for j in range(n):
        Y[k * n + j], Y[i * n + j] = Y[i * n + j], Y[k * n + j]
    scales[k], scales[i] = scales[i], scales[k]
    right[k], right[i] = right[i], right[k]
    order[k], order[i] = order[i], order[k]


def largest_entry(n: int, k: int, row: Floats) -> int:
    """Return the index j, k <= j < n, of the element of `row` with the largest size."""
    best = k
    for j in range(k + 1, n):
        if abs(row[j]) > abs(row[best]):
            best = j
    return best


def exchange(n: int, m: int, k: int, c: int, Y: Floats) -> None:
    """Exchange columns k and c of Y (m, n), also of stored reflection vectors."""
    if c != k:
        for i in range(m):
            Y[i * n + k], Y[i * n + c] = Y[i * n + c], Y[i * n + k]


def to_places(n: int, places: Floats, x: Floats) -> None:
    """Permute x (n,) by the column exchanges of `reflect`.

    places : the columns exchanged in each step.
    """
    for k in range(n):
        c = int(places[k])
        x[k], x[c] = x[c], x[k]


def from_places(n: int, places: Floats, x: Floats) -> None:
    """Undo the permutation of x (n,) by `to_places`."""
    for back in range(n):
        k = n - 1 - back
        c = int(places[k])
        x[k], x[c] = x[c], x[k]


def mirror(n: int, k: int, row: Floats, factor_k: float, x: Floats) -> None:
    """Apply the k-th reflection of `reflect` to x (n,), in place.

    row : row k of Y, whose elements after k are the vector of the reflection.
    factor_k : its factor, p.factors[k].
    """
    along = factor_k * (x[k] + mass.product(n - k - 1, row[k + 1 :], x[k + 1 :]))
    x[k] -= along
    x[k + 1 : n] -= along * row[k + 1 : n]


def store_row_forces(p: Parameters, rank: int) -> None:
    """Store in p.u (n,) the scaled constraint forces, L^-1 A^T lambda = Q w.

    On entry p.w (rank,) is the right side of R^T w = p.w, which is solved in place.
    """
    n, u, w, diagonal = p.n, p.u, p.w, p.diagonal
    for k in range(rank):
        for j in range(k):
            w[k] -= p.Y[k * n + j] * w[j]
        w[k] /= diagonal[k]
    p.u[:] = 0.0
    u[:rank] = w[:rank]
    for i in range(rank):
        k = rank - 1 - i
        mirror(n, k, p.Y[k * n :], p.factors[k], u)
    from_places(n, p.places, u)


def multipliers(p: Parameters, rank: int) -> None:
    """Store in p.multipliers (m,) the solution lambda of R lambda = w of least norm.

    R = (R1, R2) is the factor of `reflect`, with R1 (rank, rank), and w (rank,) is p.w,
    which is overwritten; the scaling of rows is undone. With B = R1^-1 R2 and x = R1^-1
    w: lambda = (x - B z, z), where (I + B^T B) z = B^T x.

    rank : the rank of the rows.
    """
    x, out = p.x, p.multipliers
    x[:rank] = p.w[:rank]
    unscaled_backward(p, rank, x)
    if rank < p.m:
        shorten(p, rank)
    for c in range(rank, p.m):
        out[int(p.order[c])] = p.w[c - rank]
    for k in range(rank):
        out[int(p.order[k])] = x[k]


def shorten(p: Parameters, rank: int) -> None:
    """Compute the multipliers of least norm when m - rank rows are dependent.

    See `multipliers` for z, B and x. On entry p.x (rank,) is x; on return p.w (m -
    rank,) is z, the multipliers of the dependent rows, and p.x is x - B z, the
    multipliers of the others.
    """
    spare = p.m - rank
    x, B = p.x, p.free
    normal = B[rank * spare :]
    for c in range(spare):
        column = B[c * rank :]
        for k in range(rank):
            column[k] = 0.0
            if p.scales[rank + c] > 0.0:
                column[k] = p.Y[(rank + c) * p.n + k] / p.scales[rank + c]
        unscaled_backward(p, rank, column)
    z = x[rank:]
    for c in range(spare):
        z[c] = mass.product(rank, B[c * rank :], x)
        for d in range(c + 1):
            normal[c * spare + d] = mass.product(rank, B[c * rank :], B[d * rank :])
        normal[c * spare + c] += 1.0
    mass.cholesky(spare, p.full, normal)
    mass.forward(spare, p.full, normal, z)
    mass.backward(spare, p.full, normal, z, p.w)
    for c in range(spare):
        x[:rank] -= p.w[c] * B[c * rank : (c + 1) * rank]


def unscaled_backward(p: Parameters, rank: int, x: Floats) -> None:
    """Replace x (rank,) by the solution z of R1 D^-1 z = x, D = diag(p.scales).

    R1 : (rank, rank), the leading block of the factor R of `reflect`.
    """
    diagonal = p.diagonal
    for i in range(rank):
        k = rank - 1 - i
        for j in range(k + 1, rank):
            x[k] -= p.Y[j * p.n + k] * x[j] / p.scales[j]
        x[k] *= p.scales[k] / diagonal[k]


# Rounding error of reflections of a vector, in units of the roundoff of its norm.
REFLECTED = 4.0


# M (n, n), A (m, n), f (n,), b (m,); then the speeds of the laws, and their bounds
# while they slide and stick (3 laws,).
dynamics = of_model("dynamics")
# Rates of first-order states and quadratures, from q'' and lambda in p.
other_rates = of_model("other_rates")
# M (n, n), A (m, n), residuals (m,), rates (m,), the scales of each (m,).
geometry = of_model("geometry")
# Second-order residuals after a Newton step, which y holds in place of velocities: of
# the residuals (m,) and of the rates (m,), relative to their scales.
second_order = of_model("second_order")
# Rounding bounds of the forces (n,), and of the other rates.
force_rounding = of_model("force_rounding")
# dr/dy (n, d), ds/dy (m, d) and the derivatives of the rates of states and works, with
# respect to the first d components of y, at q'' and lambda in p; last the derivatives
# of these rates with respect to q'' and lambda.
slopes = of_model("slopes")


def derivative(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store y' (size,) in out."""
    solve_motion(t, y, p)
    rates(t, y, p, out)


def field(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store y' (size,) and lambda (m,) in out."""
    derivative(t, y, p, out)
    out[p.size : p.size + p.m] = p.multipliers


def rates(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Complete y' (size,) in out: velocities, q'' from p.motion, and other rates."""
    out[p.positions] = y[p.velocities]
    out[p.velocities] = p.motion[: p.n]
    if p.size > p.velocities.stop:
        other_rates(t, y, p, out[p.velocities.stop :])


def observe(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store the columns of an output row at (t, y) in out (columns,).

    The columns are those of the equations without Baumgarte's stabilising terms.
    """
    gain = p.gain
    p.gain = 0.0
    solve_motion(t, y, p)
    columns(t, y, p, out)
    p.gain = gain


def rounding(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store bounds of the rounding errors of q'' (n,) and of the other rates in out.

    The bounds are in units of the unit roundoff. The bound of q'' has a part from the
    rounding of the forces, each with a sign of its own, and one from the constraint
    forces, which the reflections spread, in the metric of M, over all coupled
    coordinates. out has length 2 size + 4; the elements after the bounds are workspace.
    """
    n = p.n
    reaction = out[p.size :]
    solve_motion(t, y, p)
    if LAWS:
        clear_open_rows(p)
    gather(p, reaction)
    force_rounding(t, y, p, out)
    p.f[:] = out[:n]
    p.b[:] = 0.0
    solve_terms(p)
    out[:n] = abs(p.motion[:n]) + REFLECTED * reaction[:n]


def gather(p: Parameters, out: Floats) -> None:
    """Store bounds (n,) of the accelerations that constraint forces alone would cause.

    The bound of coordinate i is sqrt(e / M_ii). e is the sum, over the rows of the
    group of coordinates that rows or M couple with i, of the squared norms of their
    constraint forces in the metric of 1 / diag M. Where constraint forces cancel, the
    sizes of the terms of their rows count instead: forces, and inertial coupling by M.
    The row of a slider counts for its massless coordinate alone, not for the
    coordinates that the slider follows.

    out : array of length 2 n: on return the bounds, then workspace.
    """
    n, M, lam = p.n, p.M, p.multipliers
    label = out[n:]
    join(p, label)
    push_sizes(p, p.v)
    out[:n] = 0.0
    for k in range(p.m):
        row = p.A[k * n :]
        place = own_place(p, k) if LAWS else -1
        square = 0.0
        imposed = abs(p.b[k])
        if place >= 0:
            out[int(label[place])] += followed(p, k, place)
            continue
        first = 0
        for e in range(mass.first_range(p, k), mass.first_range(p, k + 1)):
            for j in range(mass.range_begin(p, e), mass.range_end(p, e)):
                if row[j] != 0.0 and M[j * n + j] > 0.0:
                    square += row[j] * row[j] / M[j * n + j]
                    imposed += abs(row[j]) * p.v[j] / M[j * n + j]
                    first = j
        if square > 0.0:
            force = max(lam[k] * lam[k] * square, imposed * imposed / square)
            out[int(label[first])] += force
    for back in range(n):
        i = n - 1 - back
        square = out[int(label[i])]
        label[i] = 0.0
        if M[i * n + i] > 0.0:
            label[i] = sqrt(square / M[i * n + i])
    out[:n] = label[:n]


def push_sizes(p: Parameters, out: Floats) -> None:
    """Store the sizes of the terms of all forces and inertial couplings in out (n,).

    The size of coordinate j is |f_j| + sum_i |M_ji q_i''|, i not j: constraint forces
    that cancel are judged by it.
    """
    n = p.n
    for j in range(n):
        out[j] = abs(p.f[j])
    for i in range(n):
        for j in range(mass.first_column(p.inertia_first, i), i):
            out[i] += abs(p.M[i * n + j] * p.motion[j])
            out[j] += abs(p.M[i * n + j] * p.motion[i])


def followed(p: Parameters, k: int, place: int) -> float:
    """Return M_jj a^2, where a bounds the acceleration that row k imposes on q_j.

    Row k is a slider's, and place = j is the index of its coordinate. a is |b_k| plus
    the sizes of the row's terms in the other coordinates, divided by the row's element
    A_kj.
    """
    n = p.n
    row = p.A[k * n :]
    imposed = abs(p.b[k])
    for j in range(n):
        imposed += abs(row[j] * p.motion[j]) if j != place else 0.0
    if row[place] == 0.0:
        return 0.0
    imposed /= row[place]
    return float(imposed * imposed * p.M[place * n + place])


def join(p: Parameters, label: Floats) -> None:
    """Label the coordinates (n,) by groups that rows of A or of M couple.

    label[j] is the lowest index of a coordinate in the group of coordinate j.
    """
    n = p.n
    for i in range(n):
        label[i] = i
    for _ in range(n):
        changed = 0
        for k in range(n):
            begin = mass.first_column(p.inertia_first, k)
            row = p.M[k * n :]
            changed += lower(row, begin, k + 1, label, lowest(row, begin, k + 1, label))
        for k in range(p.m):
            if not (LAWS and own_place(p, k) >= 0):
                changed += join_row(p, k, label)
        if changed == 0:
            return


def join_row(p: Parameters, k: int, label: Floats) -> int:
    """Set the labels of the coordinates in row k of A to the lowest of them.

    Return the number of changes.

    label : (n,), the labels of the coordinates.
    """
    row = p.A[k * p.n :]
    least = inf
    for e in range(mass.first_range(p, k), mass.first_range(p, k + 1)):
        begin, end = mass.range_begin(p, e), mass.range_end(p, e)
        least = min(least, lowest(row, begin, end, label))
    changed = 0
    for e in range(mass.first_range(p, k), mass.first_range(p, k + 1)):
        begin, end = mass.range_begin(p, e), mass.range_end(p, e)
        changed += lower(row, begin, end, label, least)
    return changed


def lowest(row: Floats, begin: int, end: int, label: Floats) -> float:
    """Return the least label of the coordinates j, begin <= j < end, with row_j != 0.

    Infinity where there are none.

    row : shape (n,), of A or of M.
    """
    least = inf
    for j in range(begin, end):
        if row[j] != 0.0:
            least = min(least, label[j])
    return least


def lower(row: Floats, begin: int, end: int, label: Floats, least: float) -> int:
    """Set label[j] above `least` to `least` where row_j != 0, begin <= j < end.

    Return the number of changes.

    row : shape (n,), of A or of M.
    """
    changed = 0
    for j in range(begin, end):
        if row[j] != 0.0 and label[j] > least:
            label[j] = least
            changed += 1
    return changed


def position_step(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store the change (n,) of q, least in the metric of M, that makes residuals zero.

    The change is a Newton step for the linearised constraints.

    out : (n + 3,), the change; then the largest residual relative to its scale, 0, and
        the largest second-order residual after the step, see `second_order_residual`.
    """
    geometry(t, y, p, p.terms)
    correction(p, p.gaps, p.gap_scales, out)
    drop_lost(y, p, p.gaps, out)
    out[p.n + 1] = 0.0
    out[p.n + 2] = second_order_residual(0, t, y, p, out)


def drop_lost(x: Floats, p: Parameters, residuals: Floats, step: Floats) -> None:
    """Set the Newton step (n,) to 0 if, rounded, the step reduces no residual.

    Far from the origin, or at high speeds, some components of the step are below the
    spacing of doubles; the other components would drift with each projection.

    x : positions, or velocities, in its first n elements.
    residuals : (m,), before the step.
    """
    n, lost = p.n, 0.0
    for j in range(n):
        if step[j] != 0.0 and x[j] + step[j] == x[j]:
            lost = 1.0
    if lost > 0.0:
        for k in range(int(p.ranked) if LAWS else p.m):
            i = int(p.order[k])
            row = p.A[i * n :]
            after = residuals[i]
            for j in range(n):
                after += row[j] * ((x[j] + step[j]) - x[j])
            if abs(after) < abs(residuals[i]):
                lost = 0.0
    if lost > 0.0:
        step[:n] = 0.0


def velocity_step(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store the change (n,) of q', least in the metric of M, that makes rates zero.

    The rates are A q' + g_t, with g_t the time derivative of the residuals at fixed q.

    out : (n + 3,), the change; then the largest rate relative to its scale, the
        smallest diagonal element sigma of R (see `reflect`), and the largest
        second-order residual after the step, see `second_order_residual`.
    """
    noting = p.least_sigma >= NOTE
    geometry(t, y, p, p.terms)
    correction(p, p.gap_rates, p.rate_scales, out)
    drop_lost(y[p.velocities], p, p.gap_rates, out)
    out[p.n + 1] = p.sigma
    out[p.n + 2] = second_order_residual(p.m, t, y, p, out)
    if LAWS:
        update_held_lengths(p)
        if noting:
            note_held_directions(p)
    else:
        update_lengths(p)
        p.reference = max(p.reference, p.sigma)


def second_order_residual(
    first: int, t: float, y: Floats, p: Parameters, step: Floats
) -> float:
    """Return the largest scaled residual after a Newton step, to second order.

    The largest is over the rows in force, of the Taylor polynomial of second order of
    each residual (`first` = 0) or of each rate (`first` = m), divided by its scale.

    y : positions, or the state.
    step : (n,), the Newton step.
    """
    n, z = p.n, p.tried
    z[:n] = y[:n]
    z[p.velocities] = step[:n]
    second_order(t, z, p, p.left)
    largest = 0.0
    for k in range(int(p.ranked) if LAWS else p.m):
        largest = max(largest, p.left[first + int(p.order[k])])
    return largest


def correction(p: Parameters, residuals: Floats, sizes: Floats, out: Floats) -> None:
    """Store the Newton step -M^-1 A^T S^-1 residuals, with S = A M^-1 A^T, in out.

    out : (n + 1,), the step and, as the last element, the largest |residual|/size.
    residuals, sizes : (m,), the residuals of the rows, and the sizes of their terms.
    """
    if LAWS:
        factor_held(p)
    else:
        factor_rows(p)
    largest = 0.0
    for k in range(int(p.ranked) if LAWS else p.m):
        i = int(p.order[k])
        p.w[k] = -residuals[i]
        if not LAWS:
            p.w[k] *= p.scales[k]
        if sizes[i] > 0.0:
            size = abs(residuals[i]) / sizes[i]
            if not size <= largest:  # or not a number
                largest = size
    if LAWS:
        correct(p)
    else:
        store_row_forces(p, int(p.ranked))
    mass.backward_mass(p, p.u, out)
    out[p.n] = largest


def solve_motion(t: float, y: Floats, p: Parameters) -> None:
    """Solve for q'' (n,) and lambda (m,) at (t, y), in p.motion."""
    dynamics(t, y, p, p.terms)
    if p.augmented > 0.0:
        mass.augment_force(p)
    if LAWS:
        store_sliding_forces(t, p)
    solve_terms(p)


def solve_terms(p: Parameters) -> None:
    """Solve for q'' (n,) and lambda (m,), in p.motion, with the terms in p.terms.

    The terms are M, A, f and b.
    """
    if LAWS:
        factor_held(p)
        respond(p)
        return
    factor_rows(p)
    mass.free_motion(p)
    for k in range(p.m):
        p.w[k] = p.scales[k] * mass.missing(p, int(p.order[k]))
    rank = int(p.ranked)
    store_row_forces(p, rank)
    multipliers(p, rank)
    p.u[:] += p.v
    mass.backward_mass(p, p.u, p.motion)


def factor_rows(p: Parameters) -> None:
    """Factor M and the rows A, unless known factors are constant in the arc."""
    if p.factored < 1.0:
        mass.factor(p)
    if p.factored < 2.0:
        store_scaled_rows(p)
        p.ranked = reflect(p)
    p.factored = p.constant


def jacobian(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store the derivatives of q'' and of the other rates with respect to the state.

    See `slopes`.

    out : matrix, row by row, with one column per state variable on which forces depend
        (p.dynamic); rows: q'', rates of first-order states, rates of works.
    """
    n, m, slope = p.n, p.m, p.slopes
    column = p.column
    dynamics(t, y, p, p.terms)
    mass.factor(p)
    store_scaled_rows(p)
    rank = reflect(p)
    solve_again(p, rank, p.motion)
    slopes(t, y, p, slope)
    width = p.dynamic.stop
    for c in range(width):
        for j in range(n):
            p.f[j] = -slope[j * width + c]
        for i in range(m):
            p.b[i] = -slope[(n + i) * width + c]
        solve_again(p, rank, column)
        for j in range(n):
            out[j * width + c] = column[j]
        for k in range(p.states + p.works):
            rate = slope[(n + m + k) * width + c]
            for i in range(n + m):
                rate += p.by_motion[k * (n + m) + i] * column[i]
            out[(n + k) * width + c] = rate


def solve_again(p: Parameters, rank: int, out: Floats) -> None:
    """Solve for q'' (n,) and lambda (m,) with other f and b and the stored factors.

    f and b in p.terms are the right sides, and are overwritten. With the factors from
    `factor` and `reflect`: L^T q'' = Q w + (1 - Q Q^T) L^-1 f, where R^T w = b, and R
    lambda = w - Q^T L^-1 f.

    out : (n + m,).
    rank : the rank of the rows.
    """
    n, f, Y, places, w = p.n, p.f, p.Y, p.places, p.w
    diagonal, x = p.diagonal, p.x
    if p.augmented > 0.0:
        mass.augment_force(p)
    mass.forward(n, p.inertia_first, p.L, f)
    to_places(n, places, f)
    for k in range(rank):
        mirror(n, k, Y[k * n :], p.factors[k], f)
    for k in range(rank):
        w[k] = p.b[int(p.order[k])] * p.scales[k]
        for j in range(k):
            w[k] -= Y[k * n + j] * w[j]
        w[k] /= diagonal[k]
        x[k] = w[k] - f[k]
        f[k] = w[k]
    for back in range(rank):
        k = rank - 1 - back
        mirror(n, k, Y[k * n :], p.factors[k], f)
    from_places(n, places, f)
    mass.backward(n, p.inertia_first, p.L, f, out)
    unscaled_backward(p, rank, x)
    out[n : n + p.m] = 0.0
    for k in range(rank):
        out[n + int(p.order[k])] = x[k]
