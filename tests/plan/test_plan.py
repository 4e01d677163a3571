"""Choices for a scene, and their reasons."""

import pytest

from lagsim.model.model import DEFAULT_RTOL
from lagsim.plan.formulation import step_parts
from tests.scenes.reference import model_text
from tests.support import case_of


def plan_of(text, **options):
    return case_of(text, **options).plan()


MIXED = """
coordinates: {x: {}, y: {}, z: {}}
energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: z}
constraints: {floor: z = 0, blade: x_dot*sin(z + 1) = y_dot*cos(z + 1)}
initial: {x: 0, y: 0, z: 0}
simulation: {duration: 1}
"""
FULL, PROJECTION = {"formulation": "full"}, {"formulation": "projection"}


def moving(kinetic):
    return f"""
parameters: {{m: 2}}
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: "{kinetic}", potential: 0}}
initial: {{x: 0, y: 0, x_dot: 0.1}}
simulation: {{duration: 1}}
"""


MASSES = {
    "m*(x_dot^2 + y_dot^2)/2": "constant, diagonal",
    "x_dot^2 + y_dot^2 + x_dot*y_dot": "constant",
    "(2 + sin(x))*(x_dot^2 + y_dot^2)": "depends on positions, diagonal",
    "x_dot^2 + y_dot^2 + sin(x)*x_dot*y_dot": "depends on positions",
    "(2 + sin(t))*(x_dot^2 + y_dot^2)": "depends on time, diagonal",
    "x_dot^2 + y_dot^2 + x_dot^4": "depends on velocities, diagonal",
}


@pytest.mark.parametrize(
    ("model", "options", "choice", "reason"),
    [
        ("elastic-pendulum", {}, "formulation: none", "no constraints"),
        ("elastic-pendulum-curve", {}, "formulation: elimination", "u from path"),
        ("pendulum-cartesian", {}, "formulation: projection", "1 of 1"),
        ("elastic-pendulum-steered", {}, "formulation: velocity projection", ""),
        ("rolling-disk", {}, "formulation: velocity projection", "velocities"),
        ("andrews", {}, "formulation: projection", "6 of 6"),
        (MIXED, PROJECTION, "formulation: projection", "1 of 2"),
        ("heavy-top", FULL, "mass matrix: depends on positions, 2 blocks", ""),
        *((moving(T), FULL, f"mass matrix: {M}", "") for T, M in MASSES.items()),
        ("elastic-pendulum", {"method": "rk4"}, "method: rk4", "requested"),
        (
            model_text("pendulum_duplicate_constraints"), {},
            "solve: loops with QR, least-norm lambda", "3 constraints have rank 1",
        ),
        (
            model_text("bricard"), {},
            "solve: loops with QR, least-norm lambda", "24 constraints have rank 23",
        ),
        (
            model_text("huygens_cycloid"), FULL,
            "mass matrix solved with the constraints",
            "singular without the constraints",
        ),
    ],
)  # fmt: skip
def test_what_is_chosen_and_why(model, options, choice, reason):
    plan = plan_of(model, **options)
    reasons = {choice.choice: choice.reason for choice in plan.choices}
    assert reason in reasons[choice]
    assert all(reasons.values())
    if choice.startswith("formulation: "):
        assert choice.endswith(f" {plan.formulation}")
    loops = choice.startswith("solve: loops") or "singular" in reason
    assert (plan.elimination is None) == loops
    assert plan.augmented == ("singular" in reason)


ELASTIC = "elastic-pendulum"


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, ("taylor", DEFAULT_RTOL, None, None)),
        ({"rtol": "1e-7", "atol": "1e-9"}, ("taylor", 1e-7, 1e-9, None)),
        ({"rtol": "0", "atol": "1e-9"}, ("dop853", 0.0, 1e-9, None)),
        ({"method": "rk4"}, ("rk4", None, None, 0.02)),
        ({"method": "rk4", "step": "0.005"}, ("rk4", None, None, 0.005)),
    ],
)
def test_tolerances_and_steps(options, expected):
    plan = plan_of(ELASTIC, **options)
    assert (plan.method, plan.rtol, plan.atol, plan.step) == expected


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "loose", "tight"),
    [
        ("kepler", "taylor", "taylor"),
        ("elastic-pendulum-forced", "taylor", "taylor"),
        ("chain-angles", "taylor", "taylor"),
        ("chain-cartesian", "taylor", "taylor"),
        # Constraints are left, and the series is long.
        ("rolling-disk", "dop853", "taylor"),
    ],
)
def test_the_method_follows_the_tolerance(name, loose, tight):
    assert plan_of(name, rtol="1e-8").method == loose
    assert plan_of(name, rtol="1e-13").method == tight
    # What no relative tolerance bounds has no order of its own; nor pays a short one.
    assert plan_of(name, rtol="0", atol="1e-9").method == "dop853"
    assert plan_of(name, rtol="1e-4").method == "dop853"


def coupled(count, potential, **options):
    """Plan for coordinates of mass 1 with a potential of their sum."""
    names = [f"q{k}" for k in range(count)]
    return plan_of(
        f"coordinates: {{{', '.join(f'{name}: {{}}' for name in names)}}}\n"
        f"energy: {{kinetic: ({' + '.join(f'{name}_dot^2' for name in names)})/2, "
        f"potential: ({' + '.join(names)}){potential}}}\n"
        f"initial: {{{', '.join(f'{name}: 0.1' for name in names)}}}\n"
        "simulation: {duration: 1}\n",
        **options,
    )


@pytest.mark.slow
def test_ten_thousand_slopes_are_not_compiled():
    # Of y' = (v, a(q)) by q and v, 2 n^2 for Newton's method.
    told = [coupled(n, "^4", method="radau").tape for n in (70, 71)]
    assert told == [False, True]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("n", "options", "tape"),
    [
        (300, {}, False), (400, {}, True), (400, {"method": "radau"}, True),
        (400, {"method": "taylor"}, False),  # a series needs straight-line code
    ],
)  # fmt: skip
def test_operations_that_repeat_are_not_compiled(n, options, tape):
    # Four operations of q'' a member: two differences, their difference, a factor.
    plan = plan_of(
        f"""
        parameters: {{n: {n}, k: 100, m: 2}}
        coordinates: {{u(1..n): {{}}}}
        energy:
          kinetic: sum(i = 1..n, m*u_dot(i)^2/2)
          potential: sum(i = 1..n-1, k*(u(i+1) - u(i))^2/2)
        initial: {{u(i = 1..n): 0.1*i}}
        simulation: {{duration: 1}}
        """,
        **options,
    )
    assert plan.tape is tape
    told = [choice.reason for choice in plan.choices if choice.choice == "tapes"]
    assert len(told) == tape


def test_a_row_that_vanishes_at_the_start_has_its_length_nearby():
    lengths = plan_of("""
    coordinates: {w: {}, x: {}, y: {}, z: {}}
    energy: {kinetic: (w_dot^2 + x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 0}
    constraints: {a: (1 + z^2)*w_dot = 0, b: sin(x)*y_dot = 0}
    initial: {w: 0, x: 0, y: 0, z: 0, x_dot: 1, z_dot: 1}
    simulation: {duration: 1}
    """).lengths
    assert lengths[0] == 1.0
    assert 0.0 < lengths[1] < 0.3  # a few states at about 0.1 from there


@pytest.mark.slow
@pytest.mark.parametrize(("name", "projects"), [("kepler", False), ("andrews", True)])
def test_what_has_no_constraints_projects_nothing(name, projects):
    plan = plan_of(name)
    projection, stages = step_parts(plan.reduction.equations, plan.elimination)
    assert stages > 0.0
    assert (projection > 0.0) == projects
