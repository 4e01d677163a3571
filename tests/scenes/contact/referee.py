"""Random masses, springs and stops on a line, and their motion found without lagsim.

Between events the motion is linear: the exponential of a matrix. Events are roots of
gaps and of multipliers, by bisection of that; impacts and what holds after them come
from trying every set of contacts.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import chain, combinations

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from tests.scenes.contact.motions import contact, scene

# Gaps are looked at so often in a second: no mass swings or bounces as fast.
LOOKS = 2000
# What rebounds more slowly rests: it would rise by 1e-13, for 1e-7 s.
SLOW = 1e-6
TOUCH = 1e-9
RISEN = 1e-9


@dataclass
class Line:
    """M q'' = f - K q + A^T lambda, gaps A q + c >= 0 with restitutions e."""

    M: np.ndarray
    K: np.ndarray
    f: np.ndarray
    A: np.ndarray
    c: np.ndarray
    e: np.ndarray
    q: np.ndarray
    duration: float
    springs: list[str] = field(default_factory=list)


def drawn(seed: int, duration: float = 3.0) -> Line:
    """Draw a scene that is open at the start."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    M = rng.uniform(0.5, 3.0, n)
    K, springs = np.zeros((n, n)), []
    for i in range(n):
        ends = np.zeros(n)
        ends[i] = 1.0
        other = int(rng.integers(-1, n))
        if other >= 0 and other != i:
            ends[other] = -1.0
        k = float(np.round(rng.uniform(0.0, 30.0), 3))
        K += k * np.outer(ends, ends)
        springs.append((k, ends))
    f = rng.uniform(-8.0, 4.0, n).round(3)
    rows, c = [], []
    for i in range(n):
        row = np.zeros(n)
        row[i] = 1.0
        rows.append(row)
        c.append(float(rng.uniform(0.0, 0.5)))
        if i and rng.random() < 0.8:
            row = np.zeros(n)
            row[i], row[i - 1] = 1.0, -1.0
            rows.append(row)
            c.append(float(rng.uniform(0.0, 0.4)))
    e = rng.choice([0.0, 0.3, 0.6, 0.9], len(rows))
    A, c = np.array(rows), np.round(c, 3)
    q = rng.uniform(0.1, 0.8, n).cumsum().round(3)
    texts = [f"{k!r}/2*({_sum(ends)})^2" for k, ends in springs]
    return Line(M.round(3), K, f, A, c, e, q, duration, texts)


def _sum(weights: np.ndarray) -> str:
    return " + ".join(f"({w!r})*x{j}" for j, w in enumerate(weights.tolist()))


def text(line: Line) -> str:
    """Write the model file."""
    names = [f"x{j}" for j in range(len(line.q))]
    pulls = [f"({f!r})*{x}" for f, x in zip(line.f.tolist(), names, strict=True)]
    laws = {}
    for k, (row, c, e) in enumerate(zip(line.A, line.c, line.e, strict=True)):
        laws[f"c{k}"] = contact(f"{_sum(row)} + {float(c)!r} >= 0", float(e))
    kinetic = [
        f"{m!r}*{x}_dot^2/2" for m, x in zip(line.M.tolist(), names, strict=True)
    ]
    return scene(
        " ".join(names), " + ".join(kinetic),
        " + ".join(line.springs) + " - (" + " + ".join(pulls) + ")", laws,
        dict(zip(names, line.q.tolist(), strict=True)),
        duration=line.duration, output_step=line.duration / 60,
    )  # fmt: skip


def complementary(D: np.ndarray, w: np.ndarray, noise: float) -> np.ndarray:
    """Give p >= 0 with D p + w >= 0 and one of both zero, by trying every set."""
    r = len(w)
    sets = chain.from_iterable(combinations(range(r), k) for k in range(r + 1))
    for some in map(list, sets):
        p = np.zeros(r)
        if some:
            p[some] = np.linalg.lstsq(D[np.ix_(some, some)], -w[some], rcond=None)[0]
        if np.all(p >= -noise) and np.all(D @ p + w >= -noise):
            return np.maximum(p, 0.0)
    raise AssertionError("no set of contacts holds")


class Motion:
    """The motion of a line, event by event; `times` and `kinds` of what happened."""

    def __init__(self, line: Line) -> None:
        self.line, n = line, len(line.q)
        self.n, self.t = n, 0.0
        self.y = np.concatenate([line.q, np.zeros(n), [1.0]])
        self.W = np.diag(1.0 / line.M)
        self.impacts: list[float] = []
        self.held: list[int] = []
        self._meet()

    def _matrix(self, held: list[int]) -> np.ndarray:
        """Give the matrix of y' = B y, y = (q, q', 1), while these hold."""
        n, line = self.n, self.line
        P = self.W.copy()
        if held:
            A = line.A[held]
            P -= self.W @ A.T @ np.linalg.solve(A @ self.W @ A.T, A @ self.W)
        B = np.zeros((2 * n + 1, 2 * n + 1))
        B[:n, n : 2 * n] = np.eye(n)
        B[n : 2 * n, :n], B[n : 2 * n, -1] = -P @ line.K, P @ line.f
        return B

    def _margins(self, y: np.ndarray) -> np.ndarray:
        """Give gaps, and the multipliers of what is held instead."""
        line, n = self.line, self.n
        found = line.A @ y[:n] + line.c
        if self.held:
            A = line.A[self.held]
            free = A @ self.W @ (line.f - line.K @ y[:n])
            found[self.held] = np.linalg.solve(A @ self.W @ A.T, -free)
        return found

    def _meet(self) -> None:
        """Let what touches strike, and decide what holds from here on."""
        line, n = self.line, self.n
        gaps = line.A @ self.y[:n] + line.c
        closed = [k for k in range(len(gaps)) if gaps[k] < TOUCH or k in self.held]
        self.held = []
        if not closed:
            return
        A = line.A[closed]
        D = A @ self.W @ A.T
        rates = A @ self.y[n : 2 * n]
        if np.any(rates < -TOUCH):
            self.impacts.append(self.t)
            back = line.e[closed] * np.maximum(-rates, 0.0)
            back[back < SLOW] = 0.0
            p = complementary(D, rates - back, 1e-12)
            self.y[n : 2 * n] += self.W @ A.T @ p
            rates = A @ self.y[n : 2 * n]
        stay = [i for i, rate in enumerate(rates) if rate < TOUCH]
        if stay:
            A, D = A[stay], D[np.ix_(stay, stay)]
            a = A @ self.W @ (line.f - line.K @ self.y[:n])
            p = complementary(D, a, 1e-10)
            self.held = [closed[stay[i]] for i in range(len(stay)) if p[i] > 1e-10]

    def at(self, times: np.ndarray) -> np.ndarray:
        """Give positions (k, n) at increasing times."""
        rows = []
        for t in times:
            while self._advance(float(t)):
                self._meet()
            rows.append(self.y[: self.n].copy())
        return np.array(rows)

    def _advance(self, end: float) -> bool:
        """Go on to `end`, or to the first event before it: True."""
        B = self._matrix(self.held)
        h = 1.0 / LOOKS
        step = expm(h * B)
        while self.t < end - 1e-14:
            whole = min(h, end - self.t)
            y = (step if whole == h else expm(whole * B)) @ self.y
            ends = self._dips(B, y, whole)
            roots = [self._root(B, k, x) for k, x in ends.items()]
            if found := [x for x in roots if x is not None]:
                first = min(found)
                self.y, self.t = expm(first * B) @ self.y, self.t + first
                return True
            self.y, self.t = y, self.t + whole
        return False

    def _dips(self, B: np.ndarray, y: np.ndarray, whole: float) -> dict[int, float]:
        """Give which margins become negative, and by when: also in between only."""
        found = {int(k): whole for k in np.flatnonzero(self._margins(y) < 0.0)}
        n, A = self.n, self.line.A
        before, after = A @ self.y[n : 2 * n], A @ y[n : 2 * n]
        for k in np.flatnonzero((before < 0.0) & (after > 0.0)):
            if k in self.held or int(k) in found:
                continue
            x = brentq(
                lambda x, k=k: (A @ (expm(x * B) @ self.y)[n : 2 * n])[k], 0.0, whole
            )
            if self._margins(expm(x * B) @ self.y)[k] < 0.0:
                found[int(k)] = x
        return found

    def _root(self, B: np.ndarray, k: int, whole: float) -> float | None:
        """Give when a margin vanishes that is negative after `whole`.

        What has just rebounded is looked at from a moment on at which it has risen.
        """

        def margin(x: float) -> float:
            return float(self._margins(expm(x * B) @ self.y)[k])

        begin = 0.0 if margin(0.0) > TOUCH or k in self.held else RISEN
        if begin >= whole or margin(begin) <= 0.0:
            # It lies there without a force, within rounding.
            assert margin(whole) > -TOUCH
            return None
        return float(brentq(margin, begin, whole, xtol=1e-16))
