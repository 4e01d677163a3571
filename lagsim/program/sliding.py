"""Kernels of the motion where forces are discontinuous: beside or along surfaces.

Inside an arc each surface has a side, and each discontinuous term is on one branch.
Where the fields on both sides point towards a surface, the motion follows the surface:
y' is the combination f0 + sum_k w_k (f_k - f0) that stays on all followed surfaces,
with f0 the field on their lower sides and f_k the field on the upper side of surface k.
A redundant surface, on which laws or other surfaces hold the motion, has a given share.
A surface has a row like a constraint, J (q'', s') = b, the derivative of its expression
or, where its rate is continuous, of its rate; the shares w are its multipliers. A
surface that jumps together with a followed one is carried: its side changes with the
side of the followed one. So is a surface whose expression depends on this side: the
expression has two values, either of which may reach an end of its side.

At a corner of an equality the rows of both sides hold, which no combination of fields
achieves: f_k is there the field with a force along the surface's gradient, see
`mechanics.corners`. The field is linear in this force, which is chosen so large that
the difference f_k - f0 has no rounding error from the other forces.

Source: A. F. Filippov, Differential Equations with Discontinuous Righthand Sides,
1988, sections 4 and 8.
"""

from __future__ import annotations

from math import floor, inf, sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.parameters import (
    CARRIED,
    CHOSEN,
    FOLLOWED,
    PUSH,
    REDUNDANT_SIDE,
    Parameters,
)
from lagsim.methods.parts.state import (
    columns,
    corner_levers,
    of_model,
    surface_rows,
    surfaces,
)
from lagsim.program import mass
from lagsim.tolerances import COMPUTED_ZERO, SOLUTION_ROUNDOFF, STATE_ROUNDOFF

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# Whether the model has laws, and surfaces; set by the translator.
LAWS = True
SURFACES = True

# Rates y' (size,) and lambda (m,) with each surface on its side.
field = of_model("field")
law_event_functions = of_model("law_event_functions")
share_loads = of_model("share_loads")


def derivative(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store y' (size,) in out."""
    combine(t, y, p)
    out[: p.size] = p.side_fields[: p.size]


def observe(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store the columns of an output row at (t, y) in out (columns,).

    The forces are those of the motion along the surfaces that it follows, see `show`,
    without Baumgarte's stabilising terms. At an instant, functions that step with a
    rate have the values on the sides onto which the motion goes on, where these are
    finite: rounding may leave the rate on either side.
    """
    n = p.n
    gain = p.gain
    p.gain = 0.0
    if SURFACES:
        for k in range(p.surfaces):
            # Outputs show exact roots, except on surfaces that the motion follows, and
            # at instants.
            if not p.slides[k] > 0.0 and t != p.settled[k]:
                p.floor[k] = 0.0
        set_cells(t, y, p)
    combine(t, y, p)
    p.gain = gain
    a = p.side_fields[p.velocities]
    p.motion[:n] = a[:n]
    p.multipliers[:] = p.side_fields[p.size : p.size + p.m]
    if LAWS and p.law_shares > 0.0:
        share_loads(t, y, p, p.multipliers)
    if SURFACES:
        show_decided(t, y, p, out)
    else:
        columns(t, y, p, out)


def show_decided(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store the columns in out, at an instant on the sides selected there.

    The sides and floors of the arc, which `observe` has changed for a row, are
    restored.
    """
    slides = p.slides
    marked = mark_sides(t, p)
    show(t, y, p, out)
    if marked:
        slides[: p.surfaces] = p.slides_before
        if not is_finite(p.shown_width, out):
            show(t, y, p, out)
    for k in range(p.surfaces):
        if slides[k] > 0.0:
            p.side[k] = p.low[k]
        p.floor[k] = p.least_root[k]
        if p.first_met[k] < p.last_met[k]:
            p.side[k] = p.side_before[k]


def mark_sides(t: float, p: Parameters) -> bool:
    """Mark the surfaces whose selected side determines the columns of an output row.

    If t is the time of the last instant, they are the surfaces whose expressions
    contain rates that jump, except followed ones; else none. Return whether a surface
    is marked; `p.slides_before` has the modes without the marks.
    """
    marked = False
    for k in range(p.surfaces):
        p.slides_before[k] = p.slides[k]
        decided = p.on_rates[k] > 0.0 and t == p.settled[k]
        if p.slides[k] == 0.0 and decided:
            p.slides[k] = CHOSEN
            marked = True
    return marked


def is_finite(count: int, x: Floats) -> bool:
    """Whether the first `count` elements of x are finite."""
    left = 0.0
    for i in range(count):
        left += 0.0 * x[i]  # nan if a component is nan or inf
    return left == 0.0


def show(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store the columns in out, combined like the forces of the motion along surfaces.

    The columns are c0 + sum_k w_k (c_k - c0), with c0 on the lower sides and c_k on the
    upper side of surface k, so that a force in a definition is the one that acts.
    Surfaces with a share of 1 are on their upper side in c0.
    """
    for k in range(p.surfaces):
        if p.slides[k] >= FOLLOWED and not p.share[k] < 1.0:
            set_side(k, p.high, p)
    columns(t, y, p, out)
    if p.sliding == 0.0:
        return
    width = p.shown_width
    base = p.shown[width:]
    base[:width] = out[:width]
    for k in range(p.surfaces):
        if p.slides[k] >= FOLLOWED and 0.0 < p.share[k] < 1.0:
            set_side(k, p.high, p)
            columns(t, y, p, p.shown)
            set_side(k, p.low, p)
            for i in range(width):
                if p.shown[i] != base[i]:
                    out[i] += p.share[k] * (p.shown[i] - base[i])


def set_cells(t: float, y: Floats, p: Parameters) -> None:
    """Set the cell of each table that contains its argument at the state.

    A cell is the interval between neighbouring points of a linear table. Only cells of
    p.first_met to p.last_met are set, between which steps do not end. A table along a
    level of which the motion slides is left out, since both of its cells are in use.
    """
    for k in range(p.surfaces):
        p.side_before[k] = p.side[k]
        if p.slides[k] == 0.0 and p.first_met[k] <= p.side[k] < p.last_met[k]:
            surfaces(t, y, p, p.rows)
            last = p.last_met[k] - 1.0
            p.side[k] = max(p.first_met[k], min(floor(p.rows[k]), last))


def event_functions(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store the event functions of all modes, negative where a mode has ended.

    out has the surfaces (surfaces,), then the laws (laws,).
    """
    if SURFACES:
        store_margins(t, y, p, out)
    if LAWS:
        law_event_functions(t, y, p, out[p.surfaces :])


def store_margins(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store the distances (surfaces,) of expressions or shares from ends of sides.

    A side without ends does not end where its expression has no value, either.
    """
    if p.sliding > 0.0:
        combine(t, y, p)
    if p.ends_above > 0.0:
        store_margins_above(t, y, p)
    surfaces(t, y, p, out)
    for k in range(p.surfaces):
        low = inf
        high = inf
        if p.least[k] > -inf or p.most[k] < inf:
            low = out[k] - p.least[k]
            high = p.most[k] - out[k]
        if p.ends_above > 0.0 and p.slides[k] == CARRIED:
            low = min(low, p.margin_above[k])
        if p.slides[k] == FOLLOWED:
            low = p.share[k]
            high = 1.0 - p.share[k]
        out[k] = min(low, high)


def store_margins_above(t: float, y: Floats, p: Parameters) -> None:
    """Store in p.margin_above the margins of carried surfaces, above their leaders.

    The margin of a carried surface is the distance of its expression from the nearer
    end of its side, evaluated with its leader, the surface that carries it, on the
    upper side.
    """
    for k in range(p.surfaces):
        if p.slides[k] >= FOLLOWED:
            set_side(k, p.high, p)
            surfaces(t, y, p, p.rows)
            set_side(k, p.low, p)
            for i in range(p.surfaces):
                if int(p.leader[i]) == k + 1:
                    low = p.rows[i] - p.least_above[i]
                    p.margin_above[i] = min(low, p.most_above[i] - p.rows[i])


def project_sliding(t: float, y: Floats, p: Parameters) -> None:
    """Project y, in place, onto the surfaces that the motion slides along.

    The correction is a multiple of f_k - f0, the direction in which the forces act on
    the motion along the surface. The correction is rejected if it does not reduce the
    distance from the surfaces, which happens where the gradient of a surface vanishes.
    A component that is the rounding of its correction becomes 0: a velocity at rest.
    """
    if SURFACES and p.sliding > 0.0:
        project_along(t, y, p)


def project_along(t: float, y: Floats, p: Parameters) -> None:
    """Project y, in place, onto the surfaces followed, see `project_sliding`."""
    sliding, width = int(p.sliding), p.size + p.m
    combine(t, y, p)
    store_gradient_norms(p)
    far = distance(p)
    p.former[p.dynamic] = y[p.dynamic]
    for j in range(sliding):
        change = p.side_fields[(j + 1) * width :]
        y[p.positions] += change[p.velocities] * p.right[3 * j + 1]
        y[p.driven] += change[p.driven] * p.right[3 * j + 2]
    for i in range(p.dynamic.stop):
        if abs(y[i]) <= STATE_ROUNDOFF * abs(y[i] - p.former[i]):
            y[i] = 0.0
    surface_rows(t, y, p, p.rows)
    if not distance(p) <= far:
        y[p.dynamic] = p.former[p.dynamic]


def store_gradient_norms(p: Parameters) -> None:
    """Store the 1-norm of the gradient of each followed surface in p.B (surfaces,).

    Elements of surfaces that are not followed are 0.
    """
    for k in range(p.surfaces):
        p.B[k] = 0.0
        if p.slides[k] == FOLLOWED:
            for e in range(int(p.row_starts[k]), int(p.row_starts[k + 1])):
                p.B[k] += abs(p.J[e])


def distance(p: Parameters) -> float:
    """Return the distance of the state from the followed surfaces, summed over them.

    The distance from a surface is |residual| + |rate|, over the gradient's norm in p.B.
    """
    far = 0.0
    for k in range(p.surfaces):
        if p.B[k] > 0.0:
            off = abs(p.residuals[k] - p.least[k])
            off += abs(p.rates[k] - p.most[k])
            far += off / p.B[k]
    return far


def combine(t: float, y: Floats, p: Parameters) -> None:
    """Compute the combined field of the motion along surfaces, in p.side_fields.

    The array has y' (size,) and lambda (m,), then f_k - f0 for each surface k that is
    followed or redundant. The shares w_k are stored in p.share.
    """
    field(t, y, p, p.side_fields)
    if SURFACES and p.sliding > 0.0:
        combine_sides(t, y, p)


def combine_sides(t: float, y: Floats, p: Parameters) -> None:
    """Compute f_k - f0 and the shares, and combine the field, see `combine`."""
    sliding, width, fields = int(p.sliding), p.size + p.m, p.side_fields
    surface_rows(t, y, p, p.rows)
    j = 0
    for k in range(p.surfaces):
        if p.slides[k] >= FOLLOWED:
            j += 1
            other = fields[j * width :]
            if p.corner[k] > 0.0 and p.slides[k] == FOLLOWED:
                p.push[k] = PUSH
                field(t, y, p, other)
                p.push[k] = 0.0
            else:
                set_side(k, p.high, p)
                field(t, y, p, other)
                set_side(k, p.low, p)
            other[:width] -= fields[:width]
    share_out(sliding, p)
    if p.corners > 0:
        jumps_at_corners(t, y, p)
        share_corners(p)


def jumps_at_corners(t: float, y: Floats, p: Parameters) -> None:
    """Store the jump of forces and rows across each kink that the motion stays on.

    The forces and rows are evaluated on both sides of the surface, with all surfaces
    that it carries on the same side: several kinks may lie at one place. The
    differences are stored in p.levers, 1 + m for each surface.
    """
    width = 1 + p.m
    corner_levers(t, y, p, p.levers)
    for k in range(p.surfaces):
        if p.slides[k] == FOLLOWED and p.corner[k] > 0.0:
            set_side(k, p.high, p)
            corner_levers(t, y, p, p.levers_above)
            set_side(k, p.low, p)
            for i in range(k * width, (k + 1) * width):
                p.levers[i] = p.levers_above[i] - p.levers[i]


def share_corners(p: Parameters) -> None:
    """Convert the forces that act at corners into shares of the upper sides, p.share.

    A share is 1/2 where no force acts on a corner; the share is -1, which ends the
    mode, where a force acts and the constraint transmits none.
    """
    width = 1 + p.m
    for k in range(p.surfaces):
        if p.slides[k] == FOLLOWED and p.corner[k] > 0.0:
            push = p.share[k] * PUSH
            jump = p.levers[k * width]
            for r in range(p.m):
                jump += p.levers[k * width + 1 + r] * p.side_fields[p.size + r]
            if jump != 0.0:
                p.share[k] = push / jump
            elif push != 0.0:
                p.share[k] = -1.0
            else:
                p.share[k] = 0.5


def set_side(k: int, which: Floats, p: Parameters) -> None:
    """Set the sides of surface k, and of surfaces carried by k, to values in `which`.

    which : p.low or p.high, the values of the lower or upper side of each surface.
    """
    for i in range(p.surfaces):
        if i == k or int(p.leader[i]) == k + 1:
            p.side[i] = which[i]


def share_out(sliding: int, p: Parameters) -> None:
    """Compute the shares w of followed surfaces, and the step of the projection.

    J (f0 + sum_k w_k (f_k - f0)) = b is solved for w, of which the shares of redundant
    surfaces are given. Two more right sides, for the residuals and the rates of the
    surfaces, determine the coefficients of the projection onto the surfaces.

    sliding : the number of followed and redundant surfaces.
    """
    width = p.size + p.m
    B, right = p.B, p.right
    i = 0
    for k in range(p.surfaces):
        if p.slides[k] == FOLLOWED:
            roundoff = p.roundoff[k]
            right[3 * i] = above(
                p.required[k] - product(k, p, p.side_fields[p.driven]), roundoff
            )
            right[3 * i + 1] = p.least[k] - p.residuals[k]
            right[3 * i + 2] = p.most[k] - p.rates[k]
            for j in range(sliding):
                change = p.side_fields[(j + 1) * width :]
                B[i * sliding + j] = above(product(k, p, change[p.driven]), roundoff)
            even_out(B[i * sliding :], sliding, right[3 * i :])
            i += 1
        elif p.slides[k] == REDUNDANT_SIDE:
            B[i * sliding : (i + 1) * sliding] = 0.0
            B[i * sliding + i] = 1.0
            right[3 * i] = p.part_above[k]
            right[3 * i + 1] = right[3 * i + 2] = 0.0
            i += 1
    solve(sliding, B, right)
    store_shares(sliding, p)


def even_out(row: Floats, count: int, right: Floats) -> None:
    """Divide row (count,) and its right sides (3,) by the largest |element| of the row.

    The rows of surfaces with different units become comparable.
    """
    size = 0.0
    for j in range(count):
        size = max(size, abs(row[j]))
    if size > 0.0:
        row[:count] /= size
        right[:3] /= size


def above(x: float, roundoff: float) -> float:
    """Return x, set to 0 where |x| <= `roundoff`."""
    return 0.0 if abs(x) <= roundoff else x


def store_shares(sliding: int, p: Parameters) -> None:
    """Store the shares in p.share, and add sum_k w_k (f_k - f0) to the field.

    A share whose combined field does not stay on its surface, beyond rounding, is set
    to -1, which ends the mode.

    sliding : the number of followed and redundant surfaces.
    """
    width = p.size + p.m
    fields = p.side_fields
    forced = fields[p.driven]
    i = 0
    for k in range(p.surfaces):
        if p.slides[k] >= FOLLOWED:
            p.share[k] = p.right[3 * i]
            p.B[i] = abs(p.required[k]) + extent(k, p, forced)
            for j in range(sliding):
                change = fields[(j + 1) * width :]
                p.B[i] += abs(p.right[3 * j]) * extent(k, p, change[p.driven])
            i += 1
    for i in range(sliding):
        fields[:width] += p.right[3 * i] * fields[(i + 1) * width : (i + 2) * width]
    i = 0
    for k in range(p.surfaces):
        if p.slides[k] == FOLLOWED:
            size = p.B[i] + extent(k, p, forced)
            left = product(k, p, forced) - p.required[k]
            if not abs(left) <= COMPUTED_ZERO * size + p.roundoff[k]:
                p.share[k] = -1.0
        if p.slides[k] >= FOLLOWED:
            i += 1


def extent(k: int, p: Parameters, a: Floats) -> float:
    """Return sum_j |J_kj a_j|, the size of the terms of surface k's row times a."""
    found = 0.0
    for e in range(int(p.row_starts[k]), int(p.row_starts[k + 1])):
        found += abs(p.J[e] * a[int(p.row_columns[e])])
    return found


def product(k: int, p: Parameters, a: Floats) -> float:
    """Return sum_j J_kj a_j, the product of surface k's row with a (n + states,)."""
    found = 0.0
    for e in range(int(p.row_starts[k]), int(p.row_starts[k + 1])):
        found += p.J[e] * a[int(p.row_columns[e])]
    return found


def solve(size: int, B: Floats, right: Floats) -> None:
    """Solve B X = right (size, 3) in place, with row pivoting.

    Where surfaces are dependent, the first column, of shares, is the solution closest
    to 1/2; free components of the other columns are 0.

    Examples
    --------
    >>> import numpy as np
    >>> B = np.array([2.0, 0.0, 0.0, 4.0])  # 2 x 2, row by row
    >>> right = np.array([1.0, 2.0, 4.0, 1.0, 2.0, 4.0])  # 2 x 3
    >>> solve(2, B, right)
    >>> right.tolist()
    [0.5, 1.0, 2.0, 0.25, 0.5, 1.0]
    """
    rank = 0
    for k in range(size):
        found = exchange_rows(size, rank, k, B, right)
        for i in range(rank + found, size):
            if found > 0:
                factor = B[i * size + k] / B[rank * size + k]
                lower, pivot = B[i * size :], B[rank * size :]
                lower[k + 1 : size] -= factor * pivot[k + 1 : size]
                right[3 * i : 3 * i + 3] -= factor * right[3 * rank : 3 * rank + 3]
            B[i * size + k] = 0.0
        rank += found
    first = 1 if rank < size else 0
    for i in range(rank, size):
        right[3 * i + first : 3 * i + 3] = 0.0
    for back in range(rank):
        i = rank - 1 - back
        k = i
        while B[i * size + k] == 0.0:
            k += 1
        for c in range(first, 3):
            value = right[3 * i + c]
            right[3 * i + c] = 0.0
            for j in range(k + 1, size):
                value -= B[i * size + j] * right[3 * j + c]
            right[3 * k + c] = value / B[i * size + k]
    if rank < size:
        share(size, rank, B, right)


def share(size: int, rank: int, B: Floats, right: Floats) -> None:
    """Store the solution closest to (1/2, ..., 1/2) in the first column of `right`.

    The solution satisfies the first `rank` rows of B x = right; B has `size` columns.
    These rows are orthonormalised; the next row of B is workspace.
    """
    shares = B[rank * size :]
    shares[:size] = 0.5
    for i in range(rank):
        row = B[i * size :]
        for j in range(i):
            other = B[j * size :]
            part = mass.product(size, row, other)
            row[:size] -= part * other[:size]
            right[3 * i] -= part * right[3 * j]
        length = sqrt(mass.product(size, row, row))
        row[:size] /= length
        part = right[3 * i] / length - mass.product(size, row, shares)
        right[3 * i] /= length
        shares[:size] += part * row[:size]
    for k in range(size):
        right[3 * k] = shares[k]


def exchange_rows(size: int, row: int, k: int, B: Floats, right: Floats) -> int:
    """Exchange rows so that the largest element of column k is in row `row`.

    Return 0 if the element is 0 within rounding, or if there is no such row; else 1.

    B : (size, size).
    right : (size, 3).
    """
    if row >= size:
        return 0
    largest = row
    whole = 0.0
    for i in range(size):
        whole = max(whole, abs(B[i * size + k]))
        if i > row and abs(B[i * size + k]) > abs(B[largest * size + k]):
            largest = i
    if largest > row:
        other, own = B[largest * size :], B[row * size :]
        for j in range(size):
            own[j], other[j] = other[j], own[j]
        for j in range(3 * row, 3 * row + 3):
            i = j + 3 * (largest - row)
            right[j], right[i] = right[i], right[j]
    return 1 if abs(B[row * size + k]) > SOLUTION_ROUNDOFF * whole else 0
