"""What is chosen for a scene, and that the reason is told."""

from __future__ import annotations

import pytest

from lagsim.errors import InputError
from lagsim.model.model import DEFAULT_RTOL
from lagsim.plan.cost import step_parts
from lagsim.plan.making import by_loops
from tests.scenes.reference import model_text
from tests.support import case_of


def plan_of(text, *, loops=False, **options):
    plan = case_of(text, **options).plan()
    return by_loops(plan) if loops else plan


def reasons(plan):
    return {choice.choice: choice.reason for choice in plan.choices}


@pytest.mark.parametrize(
    ("name", "formulation"),
    [
        ("elastic-pendulum", "none"),
        ("elastic-pendulum-curve", "elimination"),
        ("pendulum-cartesian", "projection"),
        ("elastic-pendulum-steered", "velocity projection"),
        ("rolling-disk", "velocity projection"),
        ("andrews", "projection"),
    ],
)
def test_the_formulation_follows_the_constraints(name, formulation):
    plan = plan_of(name)
    assert plan.formulation == formulation
    assert f"formulation: {formulation}" in reasons(plan)
    assert all(choice.reason for choice in plan.choices)


def test_mixed_constraints_are_projected_on_both_levels():
    plan = plan_of(
        """
coordinates: {x: {}, y: {}, z: {}}
energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: z}
constraints: {floor: z = 0, blade: x_dot*sin(z + 1) = y_dot*cos(z + 1)}
initial: {x: 0, y: 0, z: 0}
simulation: {duration: 1}
""",
        formulation="projection",
    )
    assert plan.formulation == "projection"
    assert reasons(plan)["formulation: projection"].startswith("1 of 2")


MASS = """
parameters: {{m: 2}}
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: "{kinetic}", potential: 0}}
initial: {{x: 0, y: 0, x_dot: 0.1}}
simulation: {{duration: 1}}
"""


@pytest.mark.parametrize(
    ("kinetic", "mass"),
    [
        ("m*(x_dot^2 + y_dot^2)/2", "constant, diagonal"),
        ("x_dot^2 + y_dot^2 + x_dot*y_dot", "constant"),
        ("(2 + sin(x))*(x_dot^2 + y_dot^2)", "depends on positions, diagonal"),
        ("x_dot^2 + y_dot^2 + sin(x)*x_dot*y_dot", "depends on positions"),
        ("(2 + sin(t))*(x_dot^2 + y_dot^2)", "depends on time, diagonal"),
        ("x_dot^2 + y_dot^2 + x_dot^4", "depends on velocities, diagonal"),
    ],
)
def test_the_mass_matrix_is_described(kinetic, mass):
    plan = plan_of(MASS.format(kinetic=kinetic), formulation="none")
    assert f"mass matrix: {mass}" in reasons(plan)


def test_blocks_of_the_mass_matrix_are_told():
    plan = plan_of("heavy-top", formulation="full")
    assert "mass matrix: depends on positions, 2 blocks" in reasons(plan)


def test_tolerances():
    plan = plan_of("elastic-pendulum")
    assert (plan.method, plan.rtol, plan.atol, plan.step) == (
        "taylor",
        DEFAULT_RTOL,
        None,
        None,
    )
    plan = plan_of("elastic-pendulum", rtol="1e-7", atol="1e-9")
    assert (plan.rtol, plan.atol) == (1e-7, 1e-9)
    plan = plan_of("elastic-pendulum", rtol="0", atol="1e-9")
    assert (plan.rtol, plan.atol) == (0.0, 1e-9)


@pytest.mark.parametrize(
    ("name", "loose", "tight"),
    [
        ("kepler", "taylor", "taylor"),
        ("elastic-pendulum-forced", "taylor", "taylor"),
        ("chain-angles", "taylor", "taylor"),
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


def test_a_fixed_step_has_no_tolerances():
    plan = plan_of("elastic-pendulum", method="rk4")
    assert (plan.method, plan.rtol, plan.atol, plan.step) == ("rk4", None, None, 0.02)
    assert plan_of("elastic-pendulum", method="rk4", step="0.005").step == 0.005
    assert reasons(plan)["method: rk4"] == "asked for"


@pytest.mark.parametrize(
    ("method", "goes"), [("rk4", True), ("dop853", True), ("rattle", False)]
)
def test_who_integrates_what_is_ignorable(method, goes):
    options = {"formulation": "ignorable", "method": method}
    options |= {} if method == "dop853" else {"step": "0.01"}
    if goes:
        assert plan_of("heavy-top", **options).method == method
        return
    with pytest.raises(InputError) as caught:
        plan_of("heavy-top", **options)
    [problem] = caught.value.problems
    assert problem.code == "method-refused"
    assert "ignorable coordinates" in problem.text


@pytest.mark.parametrize(("name", "projects"), [("kepler", False), ("andrews", True)])
def test_what_has_no_constraints_projects_nothing(name, projects):
    plan = plan_of(name)
    assert plan.elimination is not None
    projection, stages = step_parts(plan.reduction.equations, plan.elimination)
    assert stages > 0.0
    assert (projection > 0.0) == projects


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("pendulum_duplicate_constraints", "3 constraints have rank 1"),
        ("bricard", "24 constraints have rank 23"),
    ],
)
def test_dependent_rows_are_solved_by_loops(name, why):
    plan = plan_of(model_text(name))
    assert plan.elimination is None
    assert why in reasons(plan).values()


def test_a_singular_mass_matrix_is_solved_with_the_constraints():
    plan = plan_of(model_text("huygens_cycloid"), formulation="full")
    assert plan.augmented
    assert plan.elimination is None
    assert "mass matrix solved with the constraints" in reasons(plan)


def test_what_is_ignorable_is_not_solved_for_where_that_takes_long():
    # 100 coupled coordinates, all but one ignorable: 99^3/6 products and differences,
    # were they eliminated; the derivatives of the square take 100^2/2.
    names = [f"q{k}" for k in range(100)]
    rates = [f"{name}_dot" for name in names]
    case = case_of(
        f"coordinates: {{{', '.join(f'{name}: {{}}' for name in names)}}}\n"
        f"energy: {{kinetic: ({' + '.join(rates)})^2 + "
        f"{' + '.join(f'{rate}^2' for rate in rates)}, potential: q0}}\n"
        f"initial: {{{', '.join(f'{name}: 0' for name in names)}}}\n"
        "simulation: {duration: 1}\n"
    )
    plan = case.plan()
    assert len(case.equations.graph) < 100**2
    assert not any(choice.choice.startswith("ignorable") for choice in plan.choices)
