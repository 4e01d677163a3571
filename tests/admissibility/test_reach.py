"""Integrability: the configurations that velocity constraints permit."""

import time

import pytest

from tests.admissibility.scenes import judged, scene
from tests.patience import PATIENCE
from tests.support import MODELS

WHEELS = {
    "side": "y_dot*cos(p) = x_dot*sin(p)",
    "left": "x_dot*cos(p) + y_dot*sin(p) - 0.5*p_dot = 0.3*a_dot",
    "right": "x_dot*cos(p) + y_dot*sin(p) + 0.5*p_dot = 0.3*b_dot",
}
# A sphere of radius 1 rolls in the plane: its angular velocity from Euler angles.
SPHERE = {
    "x": "x_dot = b_dot*sin(a) - c_dot*sin(b)*cos(a)",
    "y": "y_dot = -(b_dot*cos(a) + c_dot*sin(b)*sin(a))",
}
DISK = {"x": "x_dot + 0.3*s_dot*cos(p) = 0", "y": "y_dot + 0.3*s_dot*sin(p) = 0"}


def wheels(unit, factor):
    """Return the wheels with another unit of the angle, and one relation scaled."""
    relations = {k: r.replace("(p)", f"(p/{unit!r})") for k, r in WHEELS.items()}
    relations = {
        k: r.replace("*p_dot", f"*p_dot/{unit!r}") for k, r in relations.items()
    }
    relations["side"] = f"{factor!r}*({relations['side'].replace('=', '-')}) = 0"
    return relations


def zeros(names, **values):
    return {name: values.get(name, 0) for name in names.split()}


# Relations, a start, the dimension of what can be reached and of what is hidden (None:
# not decided), the relations that enter that, and which are integrable alone.
REACHED = [
    # One form in two coordinates, free of t, always is integrable.
    ("u_dot*cos(p + 5*u) = p_dot*sin(p + 5*u)", zeros("p u", u=0.5), 1, 1, "a", None),
    ("x*x_dot + y*y_dot = 0", {"x": 1, "y": 0}, 1, 1, "a", {"a": True}),
    ("x_dot = y", {"x": 0, "y": 0}, 2, 0, "", {"a": False}),
    ("x_dot = 2*t", {"x": 0, "y": 0}, 1, 1, "a", {"a": True}),
    ("x_dot*sin(p) = y_dot*cos(p)", zeros("x y p", p=0.2), 3, 0, "", None),
    ("x_dot*sin(p) = y_dot*cos(p)", zeros("x y p"), 3, 0, "", None),
    (DISK, zeros("x y p s"), 4, 0, "", None),
    (SPHERE, zeros("x y a b c", a=0.3, b=0.7), 5, 0, "", None),
    (WHEELS, zeros("x y p a b", p=0.3), 4, 1, "left right",
     dict.fromkeys(WHEELS, False)),
    # Neither units nor the scale of a relation count.
    *[(wheels(unit, factor), zeros("x y p a b"), 4, 1, "left right", None)
      for unit in (1e-6, 1e3) for factor in (1e-8, 1e8)],
    # Rolling on what grows with time: x = (1 + t) f is hidden in the second only.
    ("x_dot = (1 + t)*f_dot", zeros("x f"), 2, 0, "", None),
    ("x_dot = (1 + t)*f_dot + f", zeros("x f"), 1, 1, "a", None),
    # With holonomic relations, which hide nothing.
    ({"h": "p^2 + f^2 = 1", "edge": "x_dot*sin(y) = p_dot*cos(y)"},
     zeros("x p f y", p=0.6, f=0.8, y=0.3), 3, 0, "", {"h": None, "edge": False}),
    ({"h": "z = x^2", "again": "z_dot = 2*x*x_dot", "w": "y_dot = 0"},
     zeros("x y z"), 1, 1, "w", None),
    ({"a": "x_dot = 0", "b": "y_dot = x*z_dot", "c": "x + y = 0"}, zeros("x y z"),
     0, 2, "a b", {"a": True, "b": False, "c": None}),
    # Dependent forms.
    ({"a": "x_dot*sin(p) = y_dot*cos(p)", "b": "2*x_dot = 2*y_dot/tan(p)"},
     zeros("x y p", p=0.2), 3, 0, "", None),
    # Three brackets deep: Engel's system.
    ({"a": "y_dot = z*x_dot", "b": "z_dot = w*x_dot"}, zeros("x y z w"), 4, 0, "",
     None),
    # A hidden one that only brackets separate from the others.
    ({"a": "z_dot = y*x_dot", "b": "w_dot = z_dot + x*y_dot"}, zeros("x y z w"),
     3, 1, "a b", None),
    # A switch of numbers leaves nothing open.
    *[({"a": f"z_dot = {factor}*y_dot"}, zeros("x y z", x=2), 3, 0, "", {"a": False})
      for factor in ("max(0, 2)*x", "abs(-3)*x", "if(1 < 2, x, 0)")],
    # In all of (y, z, w) the form dz - w dy is that of a contact structure.
    ({"h": "w = max(0, x)", "a": "z_dot = w*y_dot", "b": "u_dot = 0"},
     zeros("x y z w u", x=2, w=2), None, None, "", {"h": None, "a": False, "b": True}),
]  # fmt: skip


def reach(relations, initial):
    start = judged(scene(relations, initial), classify=True)
    verdicts = {v.name: (v.integrable, v.undecided) for v in start.verdicts}
    return start.reach, verdicts


@pytest.mark.parametrize(
    ("relations", "initial", "dimension", "hidden", "entering", "alone"), REACHED
)
def test_what_can_be_reached(relations, initial, dimension, hidden, entering, alone):
    found, each = reach(relations, initial)
    assert (found.dimension, found.hidden) == (dimension, hidden)
    assert " ".join(found.entering) == entering
    if alone is not None:
        assert each == {name: (is_one, "") for name, is_one in alone.items()}


def test_a_relation_that_is_not_linear_is_left_open():
    found, alone = reach(
        {"a": "x_dot^2 + y_dot^2 = z_dot^2", "b": "x_dot = y*z_dot"}, zeros("x y z")
    )
    assert found.dimension is None
    assert "not linear" in found.reason
    assert alone == {"a": (None, ""), "b": (False, "")}


@pytest.mark.parametrize(
    "factor",
    [
        "max(0, x - 1)", "min(x, 0)", "abs(x)", "heaviside(x - 1)*x", "floor(x)",
        "if(t < 1, 0, x)", "if(x < 5, 0, 1)*x", "if(y < 3, 1, x)",
    ],
)  # fmt: skip
@pytest.mark.parametrize("x", [0, 2])
def test_a_velocity_relation_with_a_switch_is_left_open(factor, x):
    # By the branch of x = 0 alone most are z_dot = 0, which is integrable; by that of
    # x = 2 the form dz - x dy, which is not.
    found, alone = reach({"a": f"z_dot = {factor}*y_dot"}, zeros("x y z", x=x))
    (integrable, why) = alone["a"]
    assert found.dimension is found.hidden is integrable is None
    assert "`a`" in why
    assert "switch" in why


@pytest.mark.slow
def test_ten_coordinates_and_four_relations_take_less_than_a_second():
    relations = {
        f"c{k}": f"sin(q{k})*q{k + 1}_dot*exp(q7)"
        f" = cos(q{k})*q{k + 2}_dot + q{k + 3}*q{k}_dot"
        for k in range(4)
    }
    ten = " ".join(f"q{k}" for k in range(10))
    text = scene(relations, zeros(ten, q4=0.3, q5=0.2))
    start = time.process_time()
    found = judged(text, classify=True).reach
    assert time.process_time() - start < 1.0 * PATIENCE
    assert found.dimension is not None


@pytest.mark.parametrize(
    ("name", "dimension", "integrable"),
    [
        ("elastic-pendulum-steered", 1, True), ("chaplygin-sleigh", 3, False),
        ("rolling-disk", 5, False), ("rolling-disk-steady", 5, False),
    ],
)  # fmt: skip
def test_shipped_models(name, dimension, integrable):
    start = judged((MODELS / f"{name}.yaml").read_text(), classify=True)
    assert start.reach.dimension == dimension
    assert {v.integrable for v in start.verdicts} == {integrable}
