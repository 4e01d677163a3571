"""Switches whose arguments reach their levels and stay there for a time.

A unit force acts while `table(...)`, or a power of `max`, is not 0: until FALL, and
again from RISE on. Velocities are times, in closed form.
"""

import pytest

from tests.support import simulate

FALL, RISE, END = 1.25, 2.5, 4.0
OTHERS = [[0, 1], [FALL, 3], [RISE, 3], [9, 8]]
ON = FALL + END - RISE
SCENE = """
coordinates: {{q: {{}}, p: {{}}}}
energy: {{kinetic: {m}*q_dot^2/2 + p_dot^2/2, potential: 0}}
tables:
  T: {{points: {points}, interpolation: {kind}, outside: hold}}
  S: {{points: {others}, interpolation: {kind}, outside: hold}}
definitions: {{used: "T(t) + S(t)"}}
forces: {{q: "{force}", p: "{other}"}}
{more}
initial: {{q: {q}, p: {p}, q_dot: {q_dot}, p_dot: {p_dot}}}
simulation: {{duration: 4, output_step: 0.8, method: {method}{step}}}
"""
METHODS = ("auto", "dopri5", "dop853", "taylor", "radau", "rk4")
STEPS = {"rk4": ", step: 0.01"}
SWITCHES = (
    "sign({})",
    "if({} > 0, 1, 0)",
    "if(abs({}) > 0, 1, 0)",
    "if({} <= 0, 0, 1)",
    "1 - heaviside(-{})",
    "abs(sign(-{}))",
)
ARGUMENTS = (
    "(q + 100)*T({})",
    "T({})^2*(2 + sin(q))",
    "T({})*(1 + q_dot^2)",
    "(T({0}) - 0.5*S({0}) + 0.5*S({0}))*exp(-q/50)",
    f"(max({FALL} - {{0}}, 0)^3 + max({{0}} - {RISE}, 0)^2)*(q + 100)",
)


def points(way=1.0, size=1.0):
    """Return the points of a table of way*t that is 0 from FALL to RISE."""
    found = [(-9, 1), (1, 0.3), (FALL, 0), (RISE, 0), (3, 0.2), (9, 1)]
    return sorted([way * x, size * value] for x, value in found)


def velocity(
    force, method="auto", *, kind="linear", size=1.0, way=1.0, scene=SCENE, **other
):
    """Return the last velocity of q, after a run to its end."""
    given = {"points": points(way, size), "kind": kind, "others": OTHERS}
    given |= {"m": 1.0, "other": 0, "q": 1.0, "p": 0.0, "q_dot": 0.0, "p_dot": way}
    given |= {"more": "", "force": force, "step": STEPS.get(method, "")} | other
    result = simulate(scene.format(method=method, **given))
    assert result.complete
    return result["q_dot"][-1]


def cases(*arguments):
    """Return triples of a force, a method, and a kind of tables."""
    found = [(s.format(a), a) for a in arguments for s in SWITCHES]
    turns = [(METHODS[i % 6], ("linear", "monotone")[i % 2]) for i in range(len(found))]
    return [(force, *turn) for (force, _), turn in zip(found, turns, strict=True)]


@pytest.mark.parametrize(("force", "method", "kind"), cases(*ARGUMENTS))
@pytest.mark.parametrize("place", ["t", "p", "p_dot"])
def test_a_force_ends_where_its_argument_stays_at_0(force, method, kind, place):
    other = {"other": 1, "p_dot": 0.0} if place == "p_dot" else {}
    found = velocity(force.format(place), method, kind=kind, **other)
    # A monotone table is 0 to rounding within 1e-8 of the plateau.
    assert found == pytest.approx(ON, rel=1e-9 if kind == "linear" else 2e-8)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["linear", "monotone"])
@pytest.mark.parametrize("size", [1e-6, 1e5])
def test_in_other_units_and_places(kind, size):
    force = "sign((q + 1e7)*T(-p))/{}"
    other = {"kind": kind, "size": size, "way": -1.0}
    for m, far in ((1.0, 0.0), (1e3, 1e6)):
        scene = force.format(1 / m).replace("-p", f"-{far} + p")
        found = velocity(scene, m=m, p=far, **other)
        assert found == pytest.approx(ON, rel=1e-8)


@pytest.mark.slow
def test_an_argument_that_rises_from_0_by_high_powers():
    rise = "max(t - 1, 0)^{}*(2 + sin(q))"
    for power in (2, 3, 8):
        found = velocity(f"sign({rise.format(power)})")
        assert found == pytest.approx(3.0, rel=1e-9)


@pytest.mark.slow
def test_an_argument_that_touches_its_level_keeps_its_side():
    assert velocity("sign((q + 9)*(t - 1)^4)") == pytest.approx(4.0, rel=1e-9)
    assert velocity("sign((q + 9)*abs(T(t) - 0.3))") == pytest.approx(4.0, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["linear", "monotone"])
def test_a_limit_a_damping_and_a_condition(kind):
    limit = "constraints:\n  rub: {{relation: q_dot = 0, limit: '{}'}}\n"
    switch = "if((1 + q_dot^2)*{} > 0, 1, 0)"
    for place in ("T(t)", "T(p)", "max(1.25 - p, 0)^2"):
        on = FALL if place[0] == "m" else ON
        law = limit.format("0.5*" + switch.format(place))
        found = velocity("0", kind=kind, q_dot=9.0, more=law)
        assert found == pytest.approx(9.0 - 0.5 * on, rel=1e-9)
    found = velocity("-0.1*sign((q + 9)*T(p))*q_dot", kind=kind, q_dot=9.0)
    assert found == pytest.approx(9.0 * 2.718281828459045 ** (-0.1 * ON), rel=1e-9)
    act = "modes: {u: 0}\nevents:\n  e: {at: 'sign((q + 9)*T(p)) <= 0', set: {u: 1}}\n"
    found = velocity("u", kind=kind, more=act)
    assert found == pytest.approx(END - FALL, rel=1e-9)


def test_an_argument_of_a_table_on_a_plateau():
    more = "  W: {{points: [[0, 0.5], [1, 2]], interpolation: linear, outside: hold}}\n"
    scene = SCENE.replace("definitions:", more + "definitions:", 1)
    found = velocity("W(sign((q + 9)*T(t)))", scene=scene)
    assert found == pytest.approx(2 * ON + 0.5 * (END - ON), rel=1e-9)
