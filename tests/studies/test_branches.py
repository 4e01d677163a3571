"""Branches of rests over a parameter: folds, branch points and Hopf points."""

import math

import numpy as np
import pytest

import lagsim
from lagsim.model.reader import read
from lagsim.run.interrupt import Interrupt
from lagsim.studies.branches import varied
from lagsim.studies.rest_drawing import with_specials
from tests.studies.test_rest import BLOCK, EULER, FLUTTER, HOOP, TRUSS, ZIEGLER
from tests.support import refused

pytestmark = pytest.mark.slow  # some seconds each


def points(found, kind):
    return [x for x in found.points if x["kind"] == kind]


def test_the_hoop_has_a_pitchfork():
    found = lagsim.equilibrium(HOOP, starts=4, vary={"w": (1, 6)})
    [point] = found.points
    assert point["kind"] == "branch"
    assert point["value"] == pytest.approx(math.sqrt(9.81 / 0.8), rel=1e-8)
    assert point["coordinates"]["theta"] == pytest.approx(0, abs=1e-5)
    for places in found.branches:
        for x in places:
            w, theta = x["value"], x["coordinates"]["theta"]
            assert 1 <= w <= 6
            residual = math.sin(theta) * (w * w * math.cos(theta) - 9.81 / 0.8)
            assert residual == pytest.approx(0, abs=1e-9)
            if abs(math.sin(theta)) < 1e-6 and abs(w - point["value"]) > 1e-3:
                below = math.cos(theta) > 0
                assert x["stable"] is (below and w < point["value"])


def test_the_truss_has_two_folds():
    found = lagsim.equilibrium(TRUSS, starts=4, vary={"P": (-20, 20)})
    # P = 2 k y (a/sqrt(b^2 + y^2) - 1) is extreme where b^2 a = (b^2 + y^2)^(3/2).
    a = math.hypot(1, 0.3)
    y = math.sqrt(a ** (2 / 3) - 1)
    load = 2000 * y * (a / math.hypot(1, y) - 1)
    low, high = sorted(points(found, "fold"), key=lambda x: x["value"])
    assert len(found.points) == 2
    assert [low["value"], high["value"]] == pytest.approx([-load, load], rel=1e-8)
    assert [low["coordinates"]["y"], high["coordinates"]["y"]] == pytest.approx(
        [-y, y], rel=1e-6
    )
    [branch] = found.branches
    ends = [branch[0]["value"], branch[-1]["value"]]
    assert sorted(ends) == [-20, 20]
    for x in branch:
        inside = abs(x["coordinates"]["y"]) < y
        if abs(abs(x["coordinates"]["y"]) - y) > 1e-3:
            assert x["stable"] is (not inside)


@pytest.mark.parametrize("m", [1.0, 7.5])
def test_frequencies_that_collide_count_as_hopf(m):
    model = lagsim.load(ZIEGLER).bind(m=m, k=3, l=0.5)
    found = lagsim.equilibrium(model, starts=2, vary={"P": (0, 20)})
    [point] = points(found, "hopf")
    assert point["value"] == pytest.approx(FLUTTER * 3 / 0.5, rel=1e-8)


@pytest.mark.parametrize("sign", ["", "-"])
def test_real_eigenvalues_that_meet_are_no_hopf_point(sign):
    # Of x'' = mu x' - x the eigenvalues are mu/2 +- sqrt(mu^2/4 - 1): a pair crosses
    # the imaginary axis at mu = 0, and meets on the real axis at mu = 2.
    model = lagsim.load(f"""
parameters: {{mu: {sign}0.5}}
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: x^2/2}}
forces: {{x: "{sign}mu*x_dot"}}
initial: {{x: {{guess: 0.1}}}}
simulation: {{duration: 1}}
""")
    for ends, expected in (((-1, 3), [0.0]), ((1, 4), []), ((0.5, 1.5), [])):
        low, high = sorted(-x for x in ends) if sign else ends
        found = lagsim.equilibrium(model, starts=2, vary={"mu": (low, high)})
        assert [x["value"] for x in points(found, "hopf")] == pytest.approx(
            expected, abs=1e-8
        )


def test_damping_lowers_the_flutter_load():
    # Ziegler's paradox: P l/k = 41/28 + c^2/2 with equal damping of both hinges.
    model = lagsim.load(ZIEGLER).bind(c=0.1)
    found = lagsim.equilibrium(model, starts=2, vary={"P": (0, 2.5)})
    [point] = points(found, "hopf")
    assert point["value"] == pytest.approx(41 / 28 + 0.01 / 2, rel=1e-8)


@pytest.mark.parametrize("n", [2, 3])
def test_a_column_of_links_buckles(n):
    model = lagsim.load(EULER.replace("n: 6", f"n: {n}"))
    load = 4 * 2 * n**2 * math.sin(math.pi / (2 * n)) ** 2
    ends = (0.8 * load, 1.3 * load)
    found = lagsim.equilibrium(model.bind(P=ends[0]), starts=0, vary={"P": ends})
    [point] = points(found, "branch")
    assert point["value"] == pytest.approx(load, rel=1e-8)
    assert len(found.branches) == 3


def spans(found):
    """Return the least and greatest value of each branch, sorted."""
    ends = ([places[k]["value"] for k in (0, -1)] for places in found.branches)
    return np.array(sorted(sorted(x) for x in ends))


def test_a_family_is_counted_and_a_contact_opens():
    found = lagsim.equilibrium(BLOCK, starts=0, vary={"g": (5, 15)})
    assert found.skipped > 0
    text = """
parameters: {F: 1}
coordinates: {y: {}}
energy: {kinetic: y_dot^2/2, potential: 3*y + y^2/2 - F*y}
constraints: {floor: {relation: y >= 0, restitution: 0}}
initial: {y: 0}
"""
    found = lagsim.equilibrium(text, starts=2, vary={"F": (0, 5)})
    # On the floor up to F = 3, above it from there on.
    assert spans(found) == pytest.approx(np.array([[0, 3], [3, 5]]), abs=1e-8)
    [point] = found.points
    assert (point["kind"], point["constraint"]) == ("contact", "floor")
    assert point["value"] == pytest.approx(3, rel=1e-8)
    assert point["coordinates"]["y"] == pytest.approx(0, abs=1e-8)


STOPS = """
parameters: {F: 0.5, k: 1}
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: k*x^2/2 + k*(y - x)^2/2 - F*y}
constraints:
  near: {relation: x <= 1, restitution: 0}
  far: {relation: y <= 3, restitution: 0}
initial: {x: 0.1, y: 0.3}
"""


@pytest.mark.parametrize("start", [0.5, 3.5])
@pytest.mark.parametrize(
    ("name", "ends", "near", "far"),
    # x = F/k up to x = 1; then y = 1 + F/k up to y = 3.
    [("F", (-1, 4), 1, 2), ("k", (0.2, 5), 1, 0.5)],
)
def test_branches_go_on_where_contacts_close_and_open(start, name, ends, near, far):
    text = STOPS.replace("F: 0.5", f"F: {start if name == 'F' else 1}")
    text = text.replace("k: 1}", f"k: {start if name == 'k' else 1}}}")
    found = lagsim.equilibrium(text, starts=0, vary={name: ends})
    places = {x["constraint"]: x for x in points(found, "contact")}
    assert len(found.points) == len(places) == 2
    assert places["near"]["value"] == pytest.approx(near, rel=1e-8)
    assert places["far"]["value"] == pytest.approx(far, rel=1e-8)
    assert places["near"]["coordinates"]["x"] == pytest.approx(1, rel=1e-8)
    assert places["far"]["coordinates"]["y"] == pytest.approx(3, rel=1e-8)
    low, high = sorted((near, far))
    exact = np.array([[ends[0], low], [low, high], [high, ends[1]]])
    assert spans(found) == pytest.approx(exact, abs=1e-8)
    for places in found.branches:
        assert len(places) < 500
        for x in places:
            F = x["value"] if name == "F" else 1
            k = x["value"] if name == "k" else 1
            x1 = min(F / k, 1)
            exact = {"x": x1, "y": min(x1 + F / k, 3)}
            assert x["coordinates"] == pytest.approx(exact, abs=1e-8)
            assert x["stable"] is True


def test_a_truss_that_snaps_stops_at_a_contact_past_its_fold():
    stop = "constraints: {stop: {relation: y >= -0.2, restitution: 0}}\nscene:"
    text = TRUSS.replace("scene:", stop)
    found = lagsim.equilibrium(text, starts=0, vary={"P": (-20, 20)})
    [point] = points(found, "contact")
    # The load of the truss at y = -0.2, between the fold and y = -h.
    a, y = math.hypot(1, 0.3), -0.2
    load = 2000 * y * (a / math.hypot(1, y) - 1)
    assert point["value"] == pytest.approx(load, rel=1e-8)
    assert len(points(found, "fold")) == 2
    exact = np.array([[-20, load], [load, 20]])
    assert spans(found) == pytest.approx(exact, abs=1e-6)
    assert all(len(places) < 500 for places in found.branches)


def test_a_start_value_and_unknown_names():
    with refused("unknown-name", "`y_dit`", "`y_dot`"):
        lagsim.equilibrium(TRUSS, vary={"y_dit": (0, 1)})
    with refused("usage", "`n`"):
        lagsim.equilibrium(EULER, vary={"n": (2, 3)})
    text = "coordinates: {s: {}, x: {}}\ninitial: {s: 0.5, x: 1}\n"
    text += "energy: {kinetic: (s_dot^2 + x_dot^2)/2, potential: x^2}\n"
    found = lagsim.equilibrium(text, starts=0, vary={"s": (0, 1)})
    [branch] = found.branches
    for x in branch:
        assert x["coordinates"]["s"] == pytest.approx(x["value"])


class Soon(Interrupt):
    """Interrupt that is requested after its state has been read some times."""

    def __init__(self, left):
        super().__init__()
        self.left = left

    @property
    def requested(self):
        self.left -= 1
        return self.left < 0


def test_an_interrupt_within_a_branch_keeps_the_points_so_far():
    model = read(TRUSS, "<model>")
    whole = varied(model, "P", (-20.0, 20.0))
    whole.follow(0)
    [branch] = whole.branches
    counts = []
    for left in (3, 30, 60):
        cut = varied(model, "P", (-20.0, 20.0))
        rests = cut.follow(0, Soon(left))
        assert len(rests) == 1
        [places] = cut.branches
        counts.append(len(places))
        # Its points are those of the whole branch, without gaps.
        there = np.array([cut.curves[0].visible(x.y) for x in places])
        known = np.array([whole.curves[0].visible(x.y) for x in branch])
        apart = np.abs(there[:, None] - known).max(axis=2)
        at = apart.argmin(axis=1)
        assert apart.min(axis=1).max() < 1e-9
        assert np.abs(np.diff(at)).tolist() == [1] * (len(at) - 1)
    assert counts[0] < counts[1] < counts[2] < len(branch)
    # Special points on what was followed are located.
    assert len(cut.points) <= len(whole.points)


def test_the_drawn_stable_part_ends_at_the_branch_point():
    places = [
        {"value": 0.5 + 0.2 * k, "coordinates": {"x": 0.0}, "stable": k < 3}
        for k in range(6)
    ]
    special = {"kind": "branch", "value": 1.0, "coordinates": {"x": 0.0}}
    far = {"kind": "fold", "value": 1.0, "coordinates": {"x": 5.0}}
    drawn = with_specials(places, [far, special], "x")
    assert [x["value"] for x in drawn] == pytest.approx(
        [0.5, 0.7, 0.9, 1, 1.1, 1.3, 1.5]
    )
    assert [x["stable"] for x in drawn] == [True] * 4 + [False] * 3
    # A change of stability without such a point, and a branch without a change.
    assert with_specials(places, [far], "x") == places
    assert with_specials(places[:3], [special], "x") == places[:3]
    assert with_specials([], [special], "x") == []
