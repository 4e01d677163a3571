"""Rests in corners of forces, energies and equalities, against closed forms."""

import math

import numpy as np
import pytest
import yaml
from scipy.optimize import linprog

import lagsim
from tests.support import dumped, refused

G = 9.81


def model(coordinates, potential, constraints=(), unit=1.0, at=0.0, **more):
    """Return a model of unit masses, with lengths in 1/unit, about a position."""
    kinetic = " + ".join(f"{q}_dot^2/2" for q in coordinates)
    guess = {q: {"guess": at + unit * x} for q, x in coordinates.items()}
    return dumped(
        {
            "coordinates": {q: {} for q in coordinates},
            "energy": {"kinetic": f"({kinetic})/{unit**2!r}", "potential": potential},
            "constraints": dict(constraints),
            "initial": guess,
            "simulation": {"duration": 1, "output_step": 0.5, "begin": "rest"},
        }
        | more
    )


def table(points, **more):
    return {"tables": {"tl": {"points": points, "interpolation": "linear", **more}}}


def track(shape, x=0.1, more="0"):
    weight = f"{G}*y + {more}"
    return model({"x": x, "y": 0.1}, weight, {"c": f"y = {shape}"})


# Knots on (x - 1.04)^2, of which the lowest is at x = 1.
PARABOLA = [[k / 2, (k / 2 - 1.04) ** 2] for k in range(-6, 7)]
# Models, and the position of rest.
TRACKS = {
    "abs": (track("0.5*abs(x)"), (0, 0)),
    "tilted": (track("0.5*abs(x)", more="3*x"), (0, 0)),
    "max": (track("max(0.5*x - 0.2, -0.3*x)", 0.9), (0.25, -0.075)),
    "min": (track("-min(x, -x)", -0.9), (0, 0)),
    "if": (track("if(x > 0.3, 2*(x - 0.3), 0.3*(0.3 - x))", -0.9), (0.3, 0)),
    "hypot": (track("hypot(x, 0)"), (0, 0)),
    "nested": (track("abs(abs(x) - 1)", 0.6), (1, 0)),
    # 0.5*abs(x)*(1 + 0.3*x) is level at x = -5/3, beyond the corner.
    "nearer": (track("0.5*abs(x)*(1 + 0.3*x)"), (0, 0)),
    "far": (
        model(
            {"x": 0.1, "y": 0.1}, f"{G}*y", {"c": "y = 1e6 + 0.5*abs(x - 1e6)"}, 1, 1e6
        ),
        (1e6, 1e6),
    ),
    "millimetres": (
        model({"x": 0.1, "y": 0.1}, f"{G}*y/1000", {"c": "y = 0.5*abs(x)"}, 1e3),
        (0, 0),
    ),
    "table": (
        model(
            {"x": 0.3, "y": 0.1}, f"{G}*y", {"c": "y = tl(x)"},
            **table([[-1, 1], [0.25, 0], [2, 1]]),
        ),
        (0.25, 0),
    ),
    "space": (
        model(
            {"x": 0.1, "y": -0.2, "z": 0.1}, f"{G}*z",
            {"c": "z = 0.5*abs(x) + 0.3*abs(y)"},
        ),
        (0, 0, 0),
    ),
    "valley": (
        model(
            {"x": 0.1, "y": -0.2, "z": 0.1}, f"{G}*z",
            {"c": "z = 0.5*abs(x) + (y - 0.3)^2"},
        ),
        (0, 0.3, 0),
    ),
    "pyramid": (
        model(
            {"x": 0.1, "y": -0.2, "z": 0.1}, f"{G}*z",
            {"c": "z = max(abs(x), abs(y))/2"},
        ),
        (0, 0, 0),
    ),
}  # fmt: skip


def forced(force, x=0.1, **more):
    return model({"x": x}, "0", forces={"x": force}, **more)


ENERGIES = {
    "abs": (model({"x": 0.1}, "abs(x)"), (0,)),
    "in it": (model({"x": 0.0}, "abs(x) + 0.3*x"), (0,)),
    "slope": (model({"x": 0.1}, "abs(x) + 0.3*x"), (0,)),
    "max": (model({"x": 0.7}, "max(x, -2*x)"), (0,)),
    "clip": (model({"x": 0.7}, "max(-1, min(1, x)) + x^2/4"), (-1,)),
    "three": (model({"x": 7.0}, "abs(x) + abs(x - 1) + abs(x - 2)"), (1,)),
    "nested": (model({"x": -0.6}, "abs(abs(x) - 1)"), (-1,)),
    "pendulum": (model({"x": 0.6}, "-9.81*cos(x) + 12*abs(sin(x - 0.4))"), (0.4,)),
    "two": (model({"x": 0.1, "y": 3}, "abs(x - y) + abs(y - 1)"), (1, 1)),
    "stiff": (model({"x": 0.1, "y": 0.12}, "abs(x) + 1e6*(y - x)^2/2"), (0, 0)),
    "far": (model({"x": 3}, "abs(x - 1e6)", (), 1, 1e6), (1e6,)),
    "millimetres": (model({"x": 0.1}, "abs(x)/1000", (), 1e3), (0,)),
    "table": (
        model({"x": 0.1}, "tl(x)", **table([[-1, 1], [0.25, 0], [2, 1]])),
        (0.25,),
    ),
    "periodic table": (
        model(
            {"x": 7.4}, "tl(x)", **table([[0, 1], [0.3, 0], [1, 1]], outside="repeat")
        ),
        (7.3,),
    ),
    "many knots": (
        model({"x": -2.9}, "tl(x)", **table(PARABOLA)), (1.0,),
    ),
    "sign": (forced("0.7 - 2*sign(x - 0.3)"), (0.3,)),
    "if": (forced("if(x > 0.3, -1, 5)"), (0.3,)),
    "heaviside": (forced("3 - 5*heaviside(x - 0.3)"), (0.3,)),
    "floor": (forced("2.5 - floor(x)"), (3,)),
    "ceil": (forced("2.5 - ceil(x)"), (2,)),
    "product": (forced("0.2 - sign(x - 0.3)*(2 + sign(x - 0.5))"), (0.3,)),
    "friction": (
        model({"x": 0.1}, "abs(x)", {"f": {"relation": "x_dot = 0", "limit": 0.2}}),
        (0,),
    ),
    "contact": (
        model(
            {"x": 0.1, "y": 0.1}, f"{G}*y + abs(x - 0.3)",
            {"c": {"relation": "y >= 0", "restitution": 0}},
        ),
        (0.3, 0),
    ),
}  # fmt: skip

CORNERS = {f"track {k}": x for k, x in TRACKS.items()}
CORNERS |= {f"energy {k}": x for k, x in ENERGIES.items()}


@pytest.mark.slow
@pytest.mark.parametrize(("text", "want"), CORNERS.values(), ids=CORNERS)
def test_a_guess_beside_a_corner_leads_into_it(text, want):
    result = lagsim.simulate(text, error_bar="never")
    assert result.complete
    names = [name for name in "xyz" if name in result.columns]
    for name, position in zip(names, want, strict=True):
        scale = max(1.0, abs(position))
        # The state stays where it is, to rounding of the distance from the guess.
        assert np.all(np.abs(result[name] - position) <= 1e-12 * scale)
        assert np.all(np.abs(result[f"{name}_dot"]) <= 1e-12 * scale)


@pytest.mark.slow
def test_rest_in_a_corner_of_a_large_track_lasts():
    """The rounding of a height of 1,000 m is no jump of a body at rest."""
    shape = "0.5*abs(x - 2000) + 2*abs(x) + 0.02*x + 0.001*x^2/2"
    text = model({"x": 2720.0, "h": 300.0}, "2*h", {"c": f"h = {shape}"})
    result = lagsim.simulate(text, error_bar="never")
    assert result.complete, result.reason
    assert np.all(np.abs(result["x"]) <= 1e-12)
    assert result["h"] == pytest.approx(1000.0, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["abs", "tilted", "max", "if", "table", "space"])
def test_the_track_bears_the_weight_in_its_corner(name):
    result = lagsim.simulate(TRACKS[name][0], error_bar="never")
    # The multiplier of y = f(x) is the force in y, whatever the shares of both sides.
    assert result["lambda_c"] == pytest.approx(G, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        track("0.5*abs(x)", more="6*x"),
        track("-0.5*abs(x)"),
        model({"x": 0.1}, "abs(x) + 1.3*x"),
        model({"x": 0.1}, "-abs(x)"),
        forced("sign(x - 0.3) + 0.2"),
    ],
    ids=["steeper", "ridge", "force", "hill", "pushes away"],
)
def test_a_ridge_or_a_steeper_force_leaves_no_rest(text):
    with refused("inadmissible", "x_ddot", kind=lagsim.InadmissibleError):
        lagsim.simulate(text, error_bar="never")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_rests_of_piecewise_linear_energies_are_their_minima(seed):
    """Compare with the minimum by linear programming."""
    random = np.random.default_rng(seed)
    n = 1 + seed % 3
    names = "xyz"[:n]
    more = random.choice([-0.5, 0.0, 0.25, 1.0], (2, n))
    W = np.concatenate([np.eye(n), more[np.any(more, axis=1)]])
    m = len(W)
    b = random.uniform(-2, 2, m)
    up, down = random.uniform(1, 3, (2, m))
    pull = random.uniform(-0.3, 0.3, n)

    def line(row, names=names):
        return " + ".join(f"{a!r}*{q}" for a, q in zip(row, names, strict=True))

    terms = [line(pull.tolist())]
    for row, *values in zip(
        W.tolist(), *(x.tolist() for x in (b, up, down)), strict=True
    ):
        c, k, k2 = values
        u = f"({line(row)} - {c!r})"
        terms.append(f"max({k!r}*{u}, -{k2!r}*{u})")
    guess = dict(zip(names, random.uniform(-3, 3, n).tolist(), strict=True))
    result = lagsim.simulate(model(guess, " + ".join(terms)), error_bar="never")
    assert result.complete
    # Minimise sum s_i + pull x with s_i >= up_i u_i and s_i >= -down_i u_i.
    A = np.block([[up[:, None] * W, -np.eye(m)], [-down[:, None] * W, -np.eye(m)]])
    c = np.concatenate([pull, np.ones(m)])
    d = np.concatenate([up * b, -down * b])
    found = linprog(c, A_ub=A, b_ub=d, bounds=(None, None))
    x = np.array([result[q][0] for q in names])
    u = W @ x - b
    value = float(np.sum(np.maximum(up * u, -down * u)) + pull @ x)
    assert value == pytest.approx(found.fun, rel=1e-9, abs=1e-9)
    assert all(np.ptp(result[q]) <= 1e-12 for q in names)


# --- Positions of rest


def rests(text, **more):
    document = yaml.safe_load(text)
    del document["simulation"]["begin"]
    return lagsim.equilibrium(yaml.safe_dump(document), **more).equilibria


@pytest.mark.parametrize(
    "name", ["track abs", "energy slope", "energy if", "energy two"]
)
def test_equilibrium_finds_corners_and_their_stability(name):
    text, want = CORNERS[name]
    [one] = rests(text, starts=4)
    assert [*one["coordinates"].values()] == pytest.approx(want, abs=1e-12)
    assert one["stable"] is True


@pytest.mark.slow
def test_motions_along_a_corner_decide():
    """In the valley z = |x|/2 + (y - 0.3)^2 the body swings along y: w^2 = 2 g."""
    [one] = rests(TRACKS["valley"][0], starts=2)
    assert one["stable"] is True
    assert one["lambda"] == {"c": pytest.approx(G)}
    frequencies = [abs(y) for _, y in one["eigenvalues"]]
    assert frequencies == pytest.approx([math.sqrt(2 * G)] * 2, rel=1e-9)


def test_a_rest_on_a_ridge_is_unstable():
    found = rests(model({"x": 0.0}, "x^2 - abs(x)"), starts=8)
    stable = {round(one["coordinates"]["x"], 9): one["stable"] for one in found}
    assert stable == {0.0: False, 0.5: True, -0.5: True}
    ridge = next(one for one in found if not one["stable"])
    assert ridge["reason"] == "ridge"
