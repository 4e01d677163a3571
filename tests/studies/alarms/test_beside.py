"""What a body's own alarms say, beside a body that does something else, or alone."""

from __future__ import annotations

import pytest

from tests.studies.judged import cautions
from tests.support import run

# A light body in units of energy `u`, each with a mistake of another kind.
SPRING = "{u}*x^2/2"
WRONG = {
    "a coarse step": ("rk4", 0.7, SPRING, ""),
    "a method that gains": ("euler", 0.02, SPRING, ""),
    "a method that gains, damped": ("euler", 0.05, SPRING, "x: -0.05*{u}*x_dot"),
    "a coarse step, driven": ("rk4", 0.8, SPRING, "x: 0.1*{u}*sin(0.3*t)"),
    "a cut in its expression": ("euler", 0.05, "{u}*(0.3*atan2(x, -1) + x^2/2)", ""),
}
# A heavy body: what it adds to T and V, a force on it, a constraint.
OTHERS = {
    "heavy": ("z", "M*z_dot^2/2", "M*z^2/2", "", ""),
    "driven": ("z", "M*z_dot^2/2", "M*z^2/2", "z: M*sin(0.7*t)", ""),
    "damped": ("z", "M*z_dot^2/2", "M*z^2/2", "z: -0.1*M*z_dot", ""),
    "moved": ("z", "M*z_dot^2/2", "M*z^2*(1 + 0.1*sin(t))/2", "", ""),
    "bouncing": (
        "z", "M*z_dot^2/2", "9.81*M*z", "",
        "constraints: {{floor: {{relation: z >= 0, restitution: 0.6}}}}",
    ),
    "slipping": (
        "z", "M*z_dot^2/2", "M*z^2/2", "",
        "constraints: {{belt: {{relation: z_dot = 0.3, limit: 0.2*M}}}}",
    ),
}  # fmt: skip
SCENE = """
parameters: {{M: {M}}}
coordinates: {{x: {{}}{q}}}
energy: {{kinetic: {u}*x_dot^2/2{T}, potential: "{V}"}}
{forces}
{constraint}
initial: {{x: 1{start}}}
simulation: {{start: {t}, duration: 12.6, output_step: 0.05}}
"""


def scene(potential, force, other="", u=1.0, M=1e5, t=0.0):
    q, T, V, push, constraint = OTHERS.get(other, ("",) * 5)
    forces = ", ".join(x for x in (force, push) if x)
    return SCENE.format(
        M=M, u=u, q=q and f", {q}: {{}}", start=q and f", {q}: 1", T=T and f" + {T}",
        V=potential.format(u=u) + (V and f" + {V}"), t=t,
        forces=forces and f"forces: {{{forces.format(u=u)}}}",
        constraint=constraint.format(),
    )  # fmt: skip


def alarmed(text, **options):
    return [c for c in cautions(run(text, **options)) if c.code.startswith("energy")]


@pytest.mark.parametrize("other", OTHERS)
@pytest.mark.parametrize("wrong", WRONG)
def test_a_mistake_is_told_as_it_is_alone(wrong, other):
    method, step, *light = WRONG[wrong]
    (alone,) = alarmed(scene(*light), method=method, step=step)
    found = alarmed(scene(*light, other), method=method, step=step)
    own = [c for c in found if "motion of x has" in c.text]
    if other in ("bouncing", "slipping"):  # whose events cut steps, or have rows
        assert [c.code for c in own] == [alone.code]
    else:
        assert [c.text.replace("motion of x", "motion") for c in own] == [alone.text]
    assert all("motion of" in c.text for c in found)


@pytest.mark.parametrize("u", [1e-6, 1e6])
@pytest.mark.parametrize("M", [1e-12, 1e16])
@pytest.mark.parametrize("other", ["driven", "damped"])
def test_in_other_units_and_at_another_time(u, M, other):
    options = {"method": "rk4", "step": 0.7}
    (alone,) = alarmed(scene(SPRING, "", u=u, t=-3), **options)
    found = alarmed(scene(SPRING, "", other, u=u, M=M, t=-3), **options)
    own = [c.text for c in found if "motion of x has" in c.text]
    assert own == [alone.text.replace("motion", "motion of x")]


@pytest.mark.parametrize("other", OTHERS)
@pytest.mark.parametrize("force", ["", "x: -0.05*{u}*x_dot", "x: 0.1*{u}*sin(0.3*t)"])
@pytest.mark.parametrize("M", [1e5, 1e12])
def test_no_alarm_where_all_is_well(force, other, M):
    assert cautions(run(scene(SPRING, force, other, M=M))) == []


@pytest.mark.parametrize("first", OTHERS)
def test_a_mistake_of_the_heavy_one_is_not_the_light_ones(first):
    """A light pendulum at rest, whatever the heavy one gains."""
    text = scene(SPRING, "", first).replace("x: 1,", "x: 0,")
    found = alarmed(text, method="euler", step=0.05)
    assert all("motion of z has gained" in c.text for c in found)
