"""Numbers outside the range of doubles end a run in order, or are reported."""

import numpy as np
import pytest

from lagsim.cli import main
from lagsim.run.arcs import finite_rows
from lagsim.run.trajectory import Outcome
from tests.support import refused, run

# x' = 0.3 e^(100 t): past 1.8e308 at t = ln(1.8e308/0.3)/100 = 7.11.
GROWS = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: 100*x_dot}
initial: {x: 1, x_dot: 0.3}
simulation: {duration: 9, output_step: 0.1}
"""
LEAVES = (np.log(np.finfo(float).max) - np.log(0.3)) / 100
FALLS = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: FORCE*x}
initial: {x: 0}
simulation: {duration: 1, output_step: 0.1}
"""
# A body that lands on what a law of 1e-200 x and 1e200 x keeps it above.
LANDS = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*x}
forces: {y: exp(100*t)}
constraints: {floor: {relation: SCALE*x >= 0, restitution: 0.5}}
initial: {x: 1, y: 0}
simulation: {duration: 1, output_step: 0.1}
"""


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "dop853", "rk4", "radau"])
def test_what_grows_without_end_ends_with_its_rows(method):
    step = ", step: 0.001}" if method == "rk4" else "}"
    text = GROWS.replace("0.1}", f"0.1, method: {method}{step}")
    found = run(text)
    trajectory, table = found.trajectory, found.rows
    assert trajectory.outcome.failed
    assert np.isfinite(table[:, :3]).all()
    assert len(table) == trajectory.rows
    assert table[-1, 0] == trajectory.end
    # The square of the velocity, in work and energy, leaves them at half of that time.
    assert 0.9 * LEAVES / 2 < trajectory.end < LEAVES
    assert "at t = " in trajectory.reason
    assert "x_dot = " in trajectory.reason


@pytest.mark.parametrize("step", ["1e300", "1e200"])
@pytest.mark.parametrize("method", ["rk4", "euler", "verlet", "dop853"])
def test_steps_longer_than_any_motion(method, step):
    text = GROWS.replace("100*x_dot", "-x").replace("duration: 9", "duration: 1e301")
    wanted = f"output_step: 1e300, method: {method}"
    wanted += "" if method == "dop853" else f", step: {step}"
    if step == "1e200" and method != "dop853":
        with refused("out-of-range", "`step`", "100,000,000"):
            run(text.replace("output_step: 0.1", wanted))
        return
    found = run(text.replace("output_step: 0.1", wanted), most_steps=2000)
    assert found.trajectory.outcome.failed
    assert np.isfinite(found.rows[:, :3]).all()
    assert found.trajectory.rows >= 1


@pytest.mark.parametrize("scale", ["1e-200", "1e200", "1e-300"])
def test_a_contact_whose_compliance_leaves_doubles(scale):
    """Its square is 0, or infinite; a run either goes on or ends with a place."""
    with np.errstate(all="ignore"):
        found = run(LANDS.replace("SCALE", scale))
    assert found.trajectory.rows > 1
    assert np.isfinite(found.rows[:, :5]).all()
    assert found.trajectory.outcome.complete or "t = " in found.trajectory.reason


# Between a wall whose law doubles do not hold, and a floor that drives it there.
WALLED = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
constraints:
  wall:
    {relation: 1e-160*(abs(x) - 1/9) >= 0, restitution: 0.5, friction: 0.4,
    slip: 1e-160*x_dot}
  floor: {relation: 1e120*(y - 0.3*sin(x)) >= 0, restitution: 0}
initial: {x: 0.3, y: 1, x_dot: 0.5}
simulation: {duration: 2}
"""


@pytest.mark.slow
def test_a_contact_that_comes_to_rest_without_end_ends_the_run():
    with np.errstate(all="ignore"):
        found = run(WALLED).trajectory
    assert found.outcome is Outcome.SWITCHES_ACCUMULATE
    assert all(x in found.reason for x in ("`wall`", "t = 1.92888"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "error",
    [
        ZeroDivisionError("float division by zero"),
        OverflowError("cannot convert float infinity to integer"),
        ValueError("cannot convert float NaN to integer"),
        ValueError("array must not contain infs or NaNs"),
        ValueError("math domain error"),
        np.linalg.LinAlgError("SVD did not converge"),
    ],
)
def test_what_python_raises_of_such_numbers_is_an_ending(monkeypatch, error):
    from lagsim.run.arcs import Run

    def raised(*_arguments):
        raise error

    monkeypatch.setattr(Run, "_decide", raised)
    found = run(GROWS)
    assert found.trajectory.outcome is Outcome.NOT_FINITE
    assert found.trajectory.rows >= 1


# The limit of a brake leaves doubles at t = 0.3, while the body swings.
BRAKE = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: x^2/2 + y^2}
forces: {y: 'if(t > 0.3, 1e308*10*x, 1)'}
constraints:
  circle: x^2 + y^2 = 1.25
  brake: {relation: y_dot = 0, limit: 'if(t > 0.3, 1e308*10*x, 1)'}
initial: {x: 1, y: 0.5}
simulation: {duration: 1, output_step: 0.1}
"""


def test_laws_whose_forces_leave_doubles():
    with np.errstate(all="ignore"):
        found = run(BRAKE)
    assert found.trajectory.outcome is Outcome.NOT_FINITE
    assert found.trajectory.end == pytest.approx(0.3)


@pytest.mark.parametrize("force", ["max(log(1 - x), 1)", "max(1, log(1 - x))"])
def test_a_switch_whose_argument_has_no_value_ends_the_run(force):
    # The force is 1 up to x = t/2 + t^2/2 = 1, at t = 1.
    text = f"""
    coordinates: {{x: {{}}}}
    energy: {{kinetic: 0.5*x_dot^2, potential: 0}}
    forces: {{x: "{force}"}}
    initial: {{x: 0, x_dot: 0.5}}
    simulation: {{duration: 5, output_step: 0.1}}
    """
    found = run(text).trajectory
    assert found.outcome is Outcome.NOT_FINITE
    assert found.end == pytest.approx(1.0, rel=1e-9)
    assert len(found.events) <= 1


def test_rows_before_one_that_is_not_finite():
    rows = np.ones((4, 3))
    assert finite_rows(rows, 2) == 4
    rows[2, 2] = np.nan
    assert finite_rows(rows, 2) == 4
    rows[1, 1] = np.inf
    assert finite_rows(rows, 2) == 1


@pytest.mark.slow
def test_columns_that_are_not_finite_are_named(tmp_path, monkeypatch, capsys):
    """x' = -1e300 t: its square leaves doubles at once, and V = -1e300 x with it."""
    (tmp_path / "model.yaml").write_text(FALLS.replace("FORCE", "-1e300"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["lagsim", "run", "model.yaml", "--no-plots"])
    assert main() == 0
    told = capsys.readouterr()
    (line,) = [x for x in told.err.splitlines() if "[W320]" in x]
    for name, value in (("kinetic", "inf"), ("potential", "-inf"), ("energy", "nan")):
        assert f"`{name}` is {value} at t = 0.1, the first of 10 rows" in line
    assert "`x`" not in line
    assert "not known in energy" in told.out
