"""Logarithms and powers of two, for the choice of steps.

Both by polynomials, so that lanes of vectors have them at once, and to some ten digits:
what a step is chosen by is not known better. Interpolants at Chebyshev's nodes.
"""

from __future__ import annotations

from lagsim.native.kernels.words import exponent, two_to, unrolled

# log2(1 + f)/f for 1/sqrt(2) <= 1 + f <= sqrt(2); f times it is within 1e-11.
LOGARITHM = (
    1.4426950408708794, -0.7213475209631551, 0.4808983601762459, -0.3606736553159396,
    0.28853739437873954, -0.24045433696411997, 0.20617283226751987,
    -0.1802710257711494, 0.15878356832510718, -0.14349039375280995, 0.14495052999815844,
    -0.1414478821058739, 0.07553790398013412,
)  # fmt: skip
# 2^f for |f| <= 1/2, to rounding.
POWER = (
    1.0, 0.69314718055995, 0.24022650695910097, 0.05550410866444772,
    0.009618129107606888, 0.0013333558230164974, 0.0001540353044173605,
    1.5252657260200837e-05, 1.321544258792169e-06, 1.0208690299958306e-07,
    7.072585949269223e-09,
)  # fmt: skip
ROOT = 2.0**0.5
# Exponents of normal numbers; and what rounds to a whole number when it is added.
LEAST = -1022.0
MOST = 1023.0
ROUNDER = 1.5 * 2.0**52


def log2_of(x: float) -> float:
    """Give log2(x) of a normal number that is positive."""
    k = exponent(x)
    m = x * two_to(min(max(-k, LEAST), MOST))
    if m > ROOT:
        m = 0.5 * m
        k += 1.0
    f = m - 1.0
    found = LOGARITHM[12]
    for down in unrolled(12):
        found = found * f + LOGARITHM[11 - down]
    return k + f * found


def two_to_the(x: float) -> float:
    """Give 2^x, or the nearest power of two that is a normal number."""
    x = min(max(x, LEAST), MOST)
    k = (x + ROUNDER) - ROUNDER
    f = x - k
    found = POWER[10]
    for down in unrolled(10):
        found = found * f + POWER[9 - down]
    return found * two_to(k)
