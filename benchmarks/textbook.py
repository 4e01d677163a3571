"""Equations of motion as in textbooks, written by hand and independent of lagsim.

Each function returns the accelerations of a scene. Its arguments are numbers,
expressions of heyoka or nodes of lagsim's graph: `f` has the functions for them (`sin`,
`cos`, `sqrt`). `p` is the scene's parameters. Constrained scenes are in the form of
index 1, with the multipliers solved for along the mechanism.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np


class Numbers:
    """Functions of numbers, with which `OF` computes y' from numbers."""

    sin, cos, sqrt = np.sin, np.cos, np.sqrt


def elastic_pendulum(q, v, p, f):
    theta, u = q
    w, s = v
    r = u + p["l"]
    return [
        -(s * w * 2.0 + f.sin(theta) * p["g"]) / r,
        r * w**2 + f.cos(theta) * p["g"] - u * (p["K"] / p["M"]),
    ]


def double_pendulum(q, v, p, f):
    m1, m2, l1, l2, g = (p[name] for name in ("m1", "m2", "l1", "l2", "g"))
    s, c = f.sin(q[0] - q[1]), f.cos(q[0] - q[1])
    mu = 1.0 + m1 / m2
    # m2 (mu - cos^2) = m1 + m2 sin^2
    below = mu - c**2
    first, second = f.sin(q[0]) * (mu * g), f.sin(q[1]) * g
    # mu l1 a1 + l2 c a2 = x, l1 c a1 + l2 a2 = y
    x = -(s * v[1] ** 2 * l2 + first)
    y = s * v[0] ** 2 * l1 - second
    return [(x - c * y) / (below * l1), (mu * y - c * x) / (below * l2)]


def kepler(q, _v, p, _f):
    x, y = q
    pull = (x**2 + y**2) ** -1.5 * -p["mu"]
    return [x * pull, y * pull]


def chain_angles(q, v, p, f):
    """Newton's law for each mass, along and across its link; tensions by elimination.

    Tensions are those over m l; link k's equation along it is
    2 T_k - cos_k T_k+1 - cos_k-1 T_k-1 = w_k^2.
    """
    pull = p["g"] / p["l"]
    turns = [b - a for a, b in pairwise(q)]
    s, c = [f.sin(d) for d in turns], [f.cos(d) for d in turns]
    diagonal = [1.0] + [2.0] * len(turns)
    right = [w**2 for w in v]
    right[0] = right[0] + f.cos(q[0]) * pull
    tension = tridiagonal(diagonal, c, right)
    found = [-f.sin(q[0]) * pull + s[0] * tension[1]]
    for k in range(1, len(q)):
        across = -(s[k - 1] * tension[k - 1])
        found.append(s[k] * tension[k + 1] + across if k < len(s) else across)
    return found


def tridiagonal(diagonal, beside, right):
    """Solve d_k x_k - b_k x_k+1 - b_k-1 x_k-1 = r_k, from the last to the first."""
    d, r, ratios = list(diagonal), list(right), []
    for k in reversed(range(len(beside))):
        ratio = beside[k] / d[k + 1]
        ratios.append(ratio)
        d[k] = d[k] - ratio * beside[k]
        r[k] = r[k] + ratio * r[k + 1]
    x = [r[0] / d[0]]
    for k, ratio in enumerate(reversed(ratios)):
        x.append(r[k + 1] / d[k + 1] + ratio * x[k])
    return x


def chain_cartesian(q, v, p, _f):
    """Newton's law for each mass; multipliers from the links' second derivatives."""
    x, y, vx, vy = ([0.0, *part] for part in (q[::2], q[1::2], v[::2], v[1::2]))
    dx, dy, wx, wy = ([b - a for a, b in pairwise(part)] for part in (x, y, vx, vy))
    lengths = [a**2 + b**2 for a, b in zip(dx, dy, strict=True)]
    right = [a**2 + b**2 for a, b in zip(wx, wy, strict=True)]
    right[0] = right[0] - dy[0] * p["g"]
    beside = [
        a * c + b * d for (a, c), (b, d) in zip(pairwise(dx), pairwise(dy), strict=True)
    ]
    diagonal = [lengths[0], *(part * 2.0 for part in lengths[1:])]
    pulls = tridiagonal(diagonal, beside, right)
    forces = [(a * pull, b * pull) for a, b, pull in zip(dx, dy, pulls, strict=True)]
    found = []
    for k, (a, b) in enumerate(forces):
        last = k + 1 == len(forces)
        found += [-a if last else forces[k + 1][0] - a]
        found += [(-b if last else forces[k + 1][1] - b) - p["g"]]
    return found


def andrews(q, v, p, f):
    """Three loops, each solved for its two angles; d'Alembert's principle then.

    a, b and c are angles against the ground: beta + theta, phi + delta, omega +
    epsilon. An acceleration is (factor, rest): linear in the crank's, or in gamma's.
    """
    beta, theta, gamma, phi, delta, omega, epsilon = q
    w, w_gamma, w_delta, w_epsilon = (v[k] ** 2 for k in (0, 2, 4, 6))
    w_a, w_b, w_c = ((v[k] + v[j]) ** 2 for k, j in ((0, 1), (3, 4), (5, 6)))
    rr, ss, d, e, u, zf, zt = (p[x] for x in ("rr", "ss", "d", "e", "u", "zf", "zt"))
    a, b, c = beta + theta, phi + delta, omega + epsilon

    s_theta, c_theta = f.sin(theta), f.cos(theta)
    s_phi, c_phi, s_omega, c_omega = f.sin(phi), f.cos(phi), f.sin(omega), f.cos(omega)
    s_a, c_a = f.sin(a - gamma), f.cos(a - gamma)
    s_b, c_b = f.sin(b - gamma), f.cos(b - gamma)
    s_c, c_c = f.sin(c - gamma), f.cos(c - gamma)
    s_bg, c_bg = f.sin(beta - gamma), f.cos(beta - gamma)
    s_gd, c_gd = f.sin(gamma - delta), f.cos(gamma - delta)
    s_ge, c_ge = f.sin(gamma - epsilon), f.cos(gamma - epsilon)

    gammas = (
        s_theta * (rr / ss) / c_a,
        (w_a * (d / ss) - c_theta * w * (rr / ss) - s_a * w_gamma) / c_a,
    )
    crank = (
        c_bg * (rr / d) / c_a,
        (s_a * w_a - s_bg * w * (rr / d) - w_gamma * (ss / d)) / c_a,
    )
    deltas = (
        s_b * (-ss / zt) / c_phi,
        (c_b * w_gamma * (ss / zt) - w_b * (e / zt) - s_phi * w_delta) / c_phi,
    )
    bs = (
        c_gd * (ss / e) / c_phi,
        (w_delta * (zt / e) + s_phi * w_b - s_gd * w_gamma * (ss / e)) / c_phi,
    )
    epsilons = (
        c_c * (ss / u) / c_omega,
        (s_c * w_gamma * (ss / u) - s_omega * w_epsilon + w_c * (zf / u)) / c_omega,
    )
    cs = (
        s_ge * (ss / zf) / c_omega,
        (c_ge * w_gamma * (ss / zf) + s_omega * w_c - w_epsilon * (u / zf)) / c_omega,
    )

    # Of two bodies that hang on each other: I x'' + k y'' = force, and so for y.
    def carried(one, other, inertias, coupling, forces):
        """Return inertia and force of two bodies for the angle that moves both."""
        x = one[0] * inertias[0] + other[0] * coupling
        y = other[0] * inertias[1] + one[0] * coupling
        inertia = x * one[0] + y * other[0]
        rest = x * one[1] + y * other[1]
        return inertia, one[0] * forces[0] + other[0] * forces[1] - rest

    m4, m6, m2 = p["m.4"], p["m.6"], p["m.2"]
    lever4, lever6 = p["e"] - p["ea"], p["zf"] - p["fa"]
    k4, k6, k2 = m4 * zt * lever4, -m6 * u * lever6, m2 * p["da"] * rr
    i4 = m4 * lever4**2 + p["I.4"]
    i5 = m4 * zt**2 + p["m.5"] * (p["ta"] ** 2 + p["tb"] ** 2) + p["I.5"]
    i6 = m6 * lever6**2 + p["I.6"]
    i7 = m6 * u**2 + p["m.7"] * (p["ua"] ** 2 + p["ub"] ** 2) + p["I.7"]
    i3 = p["m.3"] * (p["sa"] ** 2 + p["sb"] ** 2) + p["I.3"]
    forces4 = (c_phi * w_b * -k4, c_phi * w_delta * k4)
    forces6 = (c_omega * w_c * -k6, c_omega * w_epsilon * k6)
    m_4, f_4 = carried(deltas, bs, (i5, i4), s_phi * k4, forces4)
    m_6, f_6 = carried(epsilons, cs, (i7, i6), s_omega * k6, forces6)

    # The spring, from C to D on the arm that turns about B.
    s_gamma, c_gamma = f.sin(gamma), f.cos(gamma)
    px = c_gamma * p["tip.x"] - s_gamma * p["tip.y"]
    py = s_gamma * p["tip.x"] + c_gamma * p["tip.y"]
    bx, by = p["B.x"] - p["C.x"], p["B.y"] - p["C.y"]
    reach = bx**2 + by**2 + p["tip.x"] ** 2 + p["tip.y"] ** 2
    long = f.sqrt((px * bx + py * by) * 2.0 + reach)
    spring = (px * by - py * bx) * (p["l0"] / long - 1.0) * p["c0"]

    m_gamma = m_4 + m_6 + i3
    f_gamma = f_4 + f_6 + spring
    i1 = p["m.1"] * p["ra"] ** 2 + p["I.1"] + m2 * rr**2
    i2 = m2 * p["da"] ** 2 + p["I.2"]
    coupling = c_theta * -k2
    along = crank[0] * coupling + i1
    across = crank[0] * i2 + coupling
    inertia = along + across * crank[0] + gammas[0] ** 2 * m_gamma
    torque = (
        p["mom"]
        - s_theta * w_a * k2
        + crank[0] * (s_theta * w * k2)
        + gammas[0] * (f_gamma - m_gamma * gammas[1])
        - across * crank[1]
    )
    turn = torque / inertia
    by_crank = [pair[0] * turn + pair[1] for pair in (crank, gammas)]
    a_gamma = by_crank[1]
    by_gamma = [pair[0] * a_gamma + pair[1] for pair in (bs, deltas, cs, epsilons)]
    return [
        turn,
        by_crank[0] - turn,
        a_gamma,
        by_gamma[0] - by_gamma[1],
        by_gamma[1],
        by_gamma[2] - by_gamma[3],
        by_gamma[3],
    ]


OF = {
    "elastic-pendulum": elastic_pendulum,
    "double-pendulum": double_pendulum,
    "kepler": kepler,
    "chain-angles": chain_angles,
    "andrews": andrews,
    "chain-cartesian": chain_cartesian,
}
