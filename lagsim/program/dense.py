"""The equations of motion solved by loops: for many coordinates and for hard cases.

    [ M  A^T ] [  q''    ]   [ f ]
    [ A   0  ] [ -lambda ] = [ b ]

M = L L^T; the columns of Y = L^-1 A^T are scaled to length 1 and Y = Q R is made by
Householder reflections with column pivoting, so that nearly parallel rows keep their
digits (S = Y^T Y would square the condition). Rows that are
redundant everywhere are set aside: away from the constraints, at the stages of a step,
they are not quite so, and which of them is left out must not change from stage to
stage. lambda is the solution of least norm over all rows, and A^T lambda is unique. M,
or what stands for it, is factored in `mass`. Rows of which some hold at times only,
LAWS, are solved for in `laws`.

The derivative of the accelerations with respect to the state is exact: with the
residuals r = M q'' - f - A^T lambda and s = A q'' - b, in which q'' and lambda stand as
variables, d(q'', lambda)/dy solves the equations of motion themselves with -dr/dy for f
and -ds/dy for b: one factorisation serves all of its columns. dr/dy and ds/dy come from
the graph. lambda is that of the rows which the decomposition chose.

Sources: G. H. Golub and C. F. Van Loan, Matrix Computations, 4th ed., sections 5.2,
5.4 and 5.5.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.parameters import NOTE, Parameters
from lagsim.methods.parts.state import columns, of_model
from lagsim.program import mass
from lagsim.program.laws import (
    correct,
    drive,
    hold,
    own_place,
    respond,
    share,
    take_out,
)
from lagsim.tolerances import DEPENDENT_ROWS, LOST_RANK

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

LAWS = False  # set by the translator


def spread(p: Parameters) -> None:
    """Make the rows of Y: L^-1 A_i, scaled, and the scales.

    The scale of a row is the largest length (m,) that it has had on the way, so that
    one that vanishes is seen to; see `keep_lengths`.
    """
    n = p.n
    for i in range(p.m):
        row = p.Y[i * n :]
        row[:n] = p.A[i * n : (i + 1) * n]
        mass.forward(n, p.L, row)
        length = max(p.lengths[i], sqrt(mass.product(n, row, row)))
        p.scales[i] = 1.0 / length if length > 0.0 else 0.0
        row[:n] *= p.scales[i]


def keep_lengths(p: Parameters) -> None:
    """Note the lengths that `spread` has scaled by, of a state on the way.

    Not of every state: what a step is tried with may lie anywhere.
    """
    for k in range(p.m):
        i = int(p.order[k])
        if p.scales[k] > 0.0:
            p.lengths[i] = max(p.lengths[i], 1.0 / p.scales[k])


def reflect(p: Parameters) -> int:
    """Triangularise Y^T by reflections with pivoting; return the rank.

    A pivoted column counts as zero past the rank that the rows have in general: away
    from the constraints, at the stages of a step, dependent rows are not quite so.

    Leaves the size of the last column that is independent in general as sigma. Row k
    of Y then holds R[0:k, k] and the k-th reflection's vector after its first
    component, which is 1. Past the rank that is so, too, as far as anything is left.
    A row is reflected onto the largest of its own entries, which is exchanged into
    place k, and noted: rounding stays among the coordinates that rows join.
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
    """Note the directions of the constraints: one for each of the first reflections."""
    n, u = p.n, p.mirrored
    p.noted = end
    for k in range(end):
        z = p.directions[n * k :]
        momentum = p.momenta[n * k :]
        u[:n] = 0.0
        u[k] = 1.0
        for before in range(k + 1):
            j = k - before
            mirror(n, j, p.Y[j * n :], p.factors[j], u)
        from_places(n, p.places, u)
        for a in range(n):
            momentum[a] = 0.0
            for j in range(a + 1):
                momentum[a] += p.L[a * n + j] * u[j]
        mass.backward(n, p.L, u, z)


def longest_row(n: int, k: int, end: int, Y: Floats) -> int:
    """Row among k, ..., end - 1 that is longest from column k on."""
    best = k
    longest = -1.0
    for i in range(k, end):
        length = rest_of_row(n, k, Y[i * n :])
        if length > longest:
            longest = length
            best = i
    return best


def set_aside(p: Parameters) -> int:
    """Put the rows that are marked in `aside` (m,) last; return how many are not."""
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
    """Square of the length of a row from column k on."""
    return mass.product(n - k, row[k:], row[k:])


def swap(p: Parameters, k: int, i: int) -> None:
    """Exchange rows k and i of Y, with their scale, right side and index."""
    n, Y, scales, right, order = p.n, p.Y, p.scales, p.w, p.order
    for j in range(n):
        Y[k * n + j], Y[i * n + j] = Y[i * n + j], Y[k * n + j]
    scales[k], scales[i] = scales[i], scales[k]
    right[k], right[i] = right[i], right[k]
    order[k], order[i] = order[i], order[k]


def largest_entry(n: int, k: int, row: Floats) -> int:
    """Where a row is largest, from column k on."""
    best = k
    for j in range(k + 1, n):
        if abs(row[j]) > abs(row[best]):
            best = j
    return best


def exchange(n: int, m: int, k: int, c: int, Y: Floats) -> None:
    """Exchange columns k and c of Y; of the reflections made, too."""
    if c != k:
        for i in range(m):
            Y[i * n + k], Y[i * n + c] = Y[i * n + c], Y[i * n + k]


def to_places(n: int, places: Floats, x: Floats) -> None:
    """Exchange the components of x (n,) as the columns were."""
    for k in range(n):
        c = int(places[k])
        x[k], x[c] = x[c], x[k]


def from_places(n: int, places: Floats, x: Floats) -> None:
    """Exchange them back."""
    for back in range(n):
        k = n - 1 - back
        c = int(places[k])
        x[k], x[c] = x[c], x[k]


def mirror(n: int, k: int, row: Floats, factor_k: float, x: Floats) -> None:
    """Apply the k-th reflection to x (n,)."""
    along = factor_k * (x[k] + mass.product(n - k - 1, row[k + 1 :], x[k + 1 :]))
    x[k] -= along
    x[k + 1 : n] -= along * row[k + 1 : n]


def impress(p: Parameters, rank: int) -> None:
    """Write u = Q w (n,) with R^T w = right side: the constraint forces times L^-1."""
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
    """Leave lambda (m,) of R lambda = w in the original scale and order, of least norm.

    With B = R1^-1 R2 and x = R1^-1 w: lambda = (x - B z, z), (I + B^T B) z = B^T x.
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
    """Leave the free multipliers z (m - rank,) in w, x - B z in x, of least norm."""
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
    mass.cholesky(spare, normal)
    mass.forward(spare, normal, z)
    mass.backward(spare, normal, z, p.w)
    for c in range(spare):
        x[:rank] -= p.w[c] * B[c * rank : (c + 1) * rank]


def unscaled_backward(p: Parameters, rank: int, x: Floats) -> None:
    """Replace x (rank,) by the solution of R1 D^-1 x, D the scales."""
    diagonal = p.diagonal
    for i in range(rank):
        k = rank - 1 - i
        for j in range(k + 1, rank):
            x[k] -= p.Y[j * p.n + k] * x[j] / p.scales[j]
        x[k] *= p.scales[k] / diagonal[k]


# What reflections leave of a vector, in units of the roundoff of its norm.
REFLECTED = 4.0


# M (n, n), A (m, n), f (n,), b (m,); then of each law its speed, and its bounds while
# it slides and sticks (3 laws,).
dynamics = of_model("dynamics")
# The rates of what follows the velocities, from q'' and lambda in p.
other_rates = of_model("other_rates")
# M (n, n), A (m, n), residuals (m,), rates (m,), the scales of each (m,).
geometry = of_model("geometry")
# Second-order residuals after Newton steps, which y holds in place of velocities: of
# the residuals (m,) and of the rates (m,), against their scales.
second_order = of_model("second_order")
# The rounding of the forces (n,), and of the rates that follow.
force_rounding = of_model("force_rounding")
# dr/dy (n, d), ds/dy (m, d) and those of the rates of states and works, by the d
# components that the motion depends on, at the q'' and lambda that p holds; last those
# of these rates by q'' and lambda.
slopes = of_model("slopes")


def derivative(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Rates y' (size,)."""
    solve_motion(t, y, p)
    rates(t, y, p, out)


def field(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Rates y' (size,) and lambda (m,)."""
    derivative(t, y, p, out)
    out[p.size : p.size + p.m] = p.multipliers
    if LAWS and p.law_shares > 0.0:
        share(p, out[p.size :])


def rates(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Rates y' (size,) of the motion that was solved for."""
    out[p.positions] = y[p.velocities]
    out[p.velocities] = p.motion[: p.n]
    if p.size > p.velocities.stop:
        other_rates(t, y, p, out[p.velocities.stop :])


def observe(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Columns of a row, without what pulls the state to the constraints."""
    gain = p.gain
    p.gain = 0.0
    solve_motion(t, y, p)
    columns(t, y, p, out)
    p.gain = gain


def rounding(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Bounds of the rounding of q'' (n,) and of other rates.

    In units of the unit roundoff: that of the forces, each with its sign, and that of
    the constraint forces. In the metric of M reflections leave it anywhere among the
    coordinates that are joined. out has room for 2 size + 4.
    """
    n = p.n
    reaction = out[p.size :]
    solve_motion(t, y, p)
    if LAWS:
        take_out(p)
    gather(p, reaction)
    force_rounding(t, y, p, out)
    p.f[:] = out[:n]
    p.b[:] = 0.0
    solve_terms(p)
    out[:n] = abs(p.motion[:n]) + REFLECTED * reaction[:n]


def gather(p: Parameters, out: Floats) -> None:
    """Bound of the accelerations of coordinates (n,) by constraint forces.

    The norm of them all in the metric of diag M, among what is joined by rows or by M.
    Where they cancel, what the addends of their rows could do counts: forces, and what
    M couples a coordinate with. A slider without mass follows the others, on which its
    row does not act: no inertia of it weighs against theirs.
    """
    n, M, lam = p.n, p.M, p.multipliers
    label = out[n:]
    join(p, label)
    out[:n] = 0.0
    for k in range(p.m):
        row = p.A[k * n :]
        place = own_place(p, k) if LAWS else -1
        square = 0.0
        asked = abs(p.b[k])
        if place >= 0:
            out[int(label[place])] += followed(p, k, place)
            continue
        first = 0
        for j in range(n):
            if row[j] != 0.0 and M[j * n + j] > 0.0:
                square += row[j] * row[j] / M[j * n + j]
                push = abs(p.f[j])
                for i in range(n):
                    if i != j:
                        push += abs(M[j * n + i] * p.motion[i])
                asked += abs(row[j]) * push / M[j * n + j]
                first = j
        if square > 0.0:
            force = max(lam[k] * lam[k] * square, asked * asked / square)
            out[int(label[first])] += force
    for back in range(n):
        i = n - 1 - back
        square = out[int(label[i])]
        label[i] = 0.0
        if M[i * n + i] > 0.0:
            label[i] = sqrt(square / M[i * n + i])
    out[:n] = label[:n]


def followed(p: Parameters, k: int, place: int) -> float:
    """Square of what row k asks of the coordinate that it acts on, times its M."""
    n = p.n
    row = p.A[k * n :]
    asked = abs(p.b[k])
    for j in range(n):
        asked += abs(row[j] * p.motion[j]) if j != place else 0.0
    if row[place] == 0.0:
        return 0.0
    asked /= row[place]
    return float(asked * asked * p.M[place * n + place])


def join(p: Parameters, label: Floats) -> None:
    """Find for each coordinate the first one that rows, or M, join it with: (n,)."""
    n = p.n
    for i in range(n):
        label[i] = i
    for _ in range(n):
        changed = 0.0
        for k in range(n + p.m):
            # The rows of M, then those of A.
            row = p.terms[k * n :]
            if LAWS and k >= n and own_place(p, k - n) >= 0:
                continue
            least = 1.0 * n
            for j in range(n):
                if row[j] != 0.0:
                    least = min(least, label[j])
            for j in range(n):
                if row[j] != 0.0 and label[j] > least:
                    label[j] = least
                    changed = 1.0
        if changed == 0.0:
            return


def position_step(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Write the least change (n,) in the metric of M that removes the residuals.

    Then the largest residual against its scale, 0, and what the change leaves, (3,).
    """
    geometry(t, y, p, p.terms)
    correction(p, p.gaps, p.gap_scales, out)
    drop_lost(y, p, p.gaps, out)
    out[p.n + 1] = 0.0
    out[p.n + 2] = residual_left(0, t, y, p, out)


def drop_lost(x: Floats, p: Parameters, residuals: Floats, step: Floats) -> None:
    """Leave no change (n,) of x that shrinks no residual: rounding takes it back.

    Far from the origin, or at high speeds, what it moves besides would drift with each
    projection. x : positions, or velocities, first; residuals : (m,), what they leave.
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
    """Write the same for the velocities and the rates, with sigma instead of 0."""
    geometry(t, y, p, p.terms)
    correction(p, p.gap_rates, p.rate_scales, out)
    drop_lost(y[p.velocities], p, p.gap_rates, out)
    out[p.n + 1] = p.sigma
    out[p.n + 2] = residual_left(p.m, t, y, p, out)
    if not LAWS:
        keep_lengths(p)
        p.reference = max(p.reference, p.sigma)


def residual_left(
    first: int, t: float, y: Floats, p: Parameters, step: Floats
) -> float:
    """Largest second-order residual after a Newton step, of the rows that hold.

    Of their residuals (first = 0), or of their rates (first = m).
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
    """-M^-1 A^T S^-1 residuals (n,), and the largest against its size (1,)."""
    if LAWS:
        hold(p)
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
        impress(p, int(p.ranked))
    mass.backward(p.n, p.L, p.u, out)
    out[p.n] = largest


def solve_motion(t: float, y: Floats, p: Parameters) -> None:
    """Leave q'' (n,) and lambda (m,) as the motion."""
    dynamics(t, y, p, p.terms)
    if p.augmented > 0.0:
        mass.augment_force(p)
    if LAWS:
        drive(t, p)
    solve_terms(p)


def solve_terms(p: Parameters) -> None:
    """Do so for the terms that are there."""
    if LAWS:
        hold(p)
        respond(p)
        return
    factor_rows(p)
    mass.free_motion(p)
    for k in range(p.m):
        p.w[k] = p.scales[k] * mass.missing(p, int(p.order[k]))
    rank = int(p.ranked)
    impress(p, rank)
    multipliers(p, rank)
    p.u[:] += p.v
    mass.backward(p.n, p.L, p.u, p.motion)


def factor_rows(p: Parameters) -> None:
    """Factor M and the rows, as far as that has not been done for the whole arc."""
    if p.factored < 1.0:
        mass.factor(p)
    if p.factored < 2.0:
        spread(p)
        p.ranked = reflect(p)
    p.factored = p.constant


def jacobian(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Write dq''/dy (n, d), see `slopes`, and those of the other rates."""
    n, m, slope = p.n, p.m, p.slopes
    column = p.column
    dynamics(t, y, p, p.terms)
    mass.factor(p)
    spread(p)
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
    """Write q'' (n,) and lambda (m,) for the f and b in the terms, which are used up.

    With what `factor` and `reflect` left: L^T q'' = Q w + (1 - Q Q^T) L^-1 f, where
    R^T w = b, and R lambda = w - Q^T L^-1 f.
    """
    n, f, Y, places, w = p.n, p.f, p.Y, p.places, p.w
    diagonal, x = p.diagonal, p.x
    if p.augmented > 0.0:
        mass.augment_force(p)
    mass.forward(n, p.L, f)
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
    mass.backward(n, p.L, f, out)
    unscaled_backward(p, rank, x)
    out[n : n + p.m] = 0.0
    for k in range(rank):
        out[n + int(p.order[k])] = x[k]
