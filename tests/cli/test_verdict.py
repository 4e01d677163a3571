"""The energy balance as a verdict: rejected rows are computed again, or not valid."""

from __future__ import annotations

import numpy as np
import pytest

from tests.cli._results import manifest, table
from tests.scenes.test_change_point import LINKAGE
from tests.support import MODELS


def anew(document):
    """Give the choices by which a run was repeated."""
    return [c for c in document["plan"] if c["choice"].startswith("repeated: ")]


def column(folder, name):
    header, rows = table(folder)
    return rows[:, header.index(name)]


def contradiction(power, *, simulation="duration: 2"):
    """Give two relations that imply each other at t = 0, and part like t^power."""
    return f"""
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}}
constraints: {{a: x + y = 1 + t^{power}, b: 2*x + 2*y = 2 + 3*t^{power}}}
initial: {{x: 1, y: 0, x_dot: 1, y_dot: -1}}
simulation: {{{simulation}}}
"""


@pytest.mark.parametrize("power", [3, 4])
def test_relations_that_part_later_are_no_answer(lagsim, write, power):
    called = lagsim("run", write(contradiction(power)), "-o", "out", "--no-plots")
    document = manifest("out")
    assert called.code == 3
    assert (document["outcome"], document["complete"]) == ("failed", False)
    assert document["error"] is None
    # They part by t^power, which is 1e-6 of their terms, 2 at first, at this time.
    since = float(document["reason"].split("from t = ")[1].split()[0])
    assert since == pytest.approx((2e-6) ** (1 / power), rel=0.5)
    assert "`b`" in document["reason"] or "`a`" in document["reason"]
    assert document["reason"] in called.err
    assert "not estimated" in called.out
    # Rows end with the last one that meets both.
    assert len(table("out")[1]) == document["rows"]
    assert since - 0.0021 < column("out", "t")[-1] < since
    assert [w["code"] for w in document["warnings"]].count("constraint-not-held") == 0


def test_relations_that_stay_together_are(lagsim, write):
    text = contradiction(3).replace("3*t^3", "2*t^3")
    assert lagsim("run", write(text), "-o", "out", "--no-plots").code == 0
    assert not anew(manifest("out"))


HILL = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: "10*exp(-(x/0.1)^2)"}
initial: {x: -5, x_dot: 1}
simulation: {duration: 10, output_step: STEP}
"""


@pytest.mark.parametrize("step", ["0.01", "0.5", "5"])
@pytest.mark.parametrize("method", ["auto", "taylor"])
def test_a_hill_is_not_flown_through(lagsim, write, method, step):
    """Half a unit of energy does not pass a hill of ten: it turns back."""
    path = write(HILL.replace("STEP", step))
    called = lagsim("run", path, "-o", "out", "--method", method, "--no-plots")
    assert called.code == 0
    assert np.max(column("out", "x")) < 0.0
    assert column("out", "x_dot")[-1] == pytest.approx(-1.0, abs=1e-9)
    document = manifest("out")
    assert document["energy_drift"] < 1e-9
    assert document["error"]["relative"] < 1e-6
    assert document["rows"] == len(table("out")[1])


PULSE = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: "exp(-((t - 50)/W)^2)"}
initial: {x: 0}
simulation: {duration: 100, output_step: 0.1}
parameters: {W: 0.05}
"""


@pytest.mark.parametrize("width", ["0.05", "0.5", "3"])
def test_a_pulse_after_a_long_rest(lagsim, write, width):
    path = write(PULSE)
    called = lagsim("run", path, "--set", f"W={width}", "-o", "out", "--no-plots")
    assert called.code == 0
    speed = float(width) * np.sqrt(np.pi)
    assert column("out", "x_dot")[-1] == pytest.approx(speed, rel=1e-9)
    assert column("out", "x")[-1] == pytest.approx(50 * speed, rel=1e-9)


def test_what_was_made_anew_is_told(lagsim, write):
    """And the table has the rows of the second attempt alone, pictures too."""
    called = lagsim("run", write(HILL.replace("STEP", "5")), "-o", "out")
    document = manifest("out")
    t = column("out", "t")
    assert t.tolist() == [0.0, 5.0, 10.0]
    assert document["rows"] == 3
    for choice in anew(document):
        assert choice["choice"] in called.out
        assert "taylor" in choice["reason"]
        assert document["method"] == "dop853"


def test_chaos_is_no_failure(lagsim):
    model = MODELS / "double-pendulum.yaml"
    called = lagsim("run", model, "--duration", "40", "-o", "out", "--no-plots")
    document = manifest("out")
    assert called.code == 0
    assert 15 < document["error"]["horizon"] < 26
    assert not anew(document)
    assert document["energy_drift"] < 1e-6


def test_fixed_steps_keep_their_warnings(lagsim):
    model = MODELS / "failing" / "oscillator.yaml"
    called = lagsim(
        "run", model, "--method", "euler", "--step", "0.01", "--duration", "100",
        "-o", "out", "--no-plots",
    )  # fmt: skip
    document = manifest("out")
    assert called.code == 0
    assert "energy-gained" in [w["code"] for w in document["warnings"]]
    assert not anew(document)


@pytest.mark.parametrize("method", ["auto", "dop853"])
def test_a_potential_that_jumps_is_no_failure(lagsim, write, method):
    """The energy's expression jumps where nothing of the motion does."""
    text = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: "x^2/2 + floor(3*x)"}
initial: {x: 1}
simulation: {duration: 10}
"""
    called = lagsim("run", write(text), "--method", method, "-o", "out", "--no-plots")
    document = manifest("out")
    assert called.code == 0
    assert not anew(document)
    t = column("out", "t")
    assert np.max(np.abs(column("out", "x") - np.cos(t))) < 1e-9
    for warning in document["warnings"]:
        assert "error of" not in warning["text"]


def test_an_impact_is_no_failure(lagsim, write):
    text = """
parameters: {T: 1.005}
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 2*(x - y)^2}
constraints: {a: "x = abs(t - T)"}
initial: {x: T, y: T, x_dot: -1, y_dot: -1}
simulation: {duration: 3}
"""
    called = lagsim("run", write(text), "-o", "out", "--no-plots")
    document = manifest("out")
    assert called.code == 0
    assert not anew(document)
    assert document["error"]["relative"] < 1e-9
    assert document["energy_drift"] < 1e-9


# Series have no finite coefficients at the start, or somewhere on the way.
NOT_ANALYTIC = {
    "drag from rest": (
        "9.81*x", "x: 0", "-0.3*sqrt(x_dot^2)*x_dot", 3,
        lambda t: -np.log(np.cosh(np.sqrt(9.81 * 0.3) * t)) / 0.3,
    ),
    "root of the time": ("0", "x: 0", "sqrt(t)", 3, lambda t: 4 / 15 * t**2.5),
    "a later root": (
        "0", "x: 0", "sqrt((t - 1)^2)^0.5", 3,
        # |t - 1|^(5/2) 4/15, less its value and slope at the start.
        lambda t: 4 / 15 * (np.abs(t - 1) ** 2.5 - 1) + 2 / 3 * t,
    ),
    "cubic drag": (
        "0", "x: 0, x_dot: 1", "-sqrt(x_dot^2)^3", 3,
        lambda t: np.sqrt(1 + 2 * t) - 1,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", NOT_ANALYTIC)
def test_auto_goes_on_by_another_method(lagsim, write, name):
    potential, initial, force, duration, truth = NOT_ANALYTIC[name]
    text = f"""
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: {potential}}}
forces: {{x: "{force}"}}
initial: {{{initial}}}
simulation: {{duration: {duration}}}
"""
    called = lagsim("run", write(text), "-o", "out", "--no-plots")
    assert called.code == 0, called.err
    t = column("out", "t")
    assert np.max(np.abs(column("out", "x") - truth(t))) < 1e-8
    assert manifest("out")["error"] is not None


@pytest.mark.parametrize("method", ["auto", "taylor"])
def test_the_method_that_takes_over_is_told(method, lagsim, write):
    text = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: "sqrt(t)"}
initial: {x: 0}
simulation: {duration: 3, method: METHOD}
"""
    called = lagsim("run", write(text.replace("METHOD", method)), "-o", "out")
    assert called.code == 0, called.err
    choices = [c["choice"] for c in manifest("out")["plan"]]
    assert "method: taylor" in choices
    assert "method: dop853 from t = 0 on" in choices


@pytest.mark.parametrize("method", ["auto", "taylor", "dop853", "radau"])
def test_a_failure_names_what_moves_and_advises_what_is_new(lagsim, write, method):
    # Against its path's friction it falls into the centre: work grows fastest there.
    text = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: -1/x}
forces: {x: -0.1*x_dot/x^3}
initial: {x: 1, x_dot: -3}
simulation: {duration: 3}
"""
    fall = text.replace("forces: {x: -0.1*x_dot/x^3}", "forces: {x: -1/x^3}")
    called = lagsim("run", write(fall), "--method", method, "-o", "out", "--no-plots")
    assert called.code == 3
    assert "x = " in called.err
    assert "`work`" not in called.err
    assert f"--method {method}" not in called.err
    if method == "auto":
        assert "--method" not in called.err


@pytest.mark.parametrize(("offset", "allowed"), [("0", 1e-7), ("1e5", 1e-4)])
def test_no_repeat_accuses_a_linkage_at_a_change_point(lagsim, write, offset, allowed):
    # A place of 1e5 is known to 1e-11, which the passage divides by the independence.
    path = write(LINKAGE.format(offset=offset))
    called = lagsim("run", path, "-o", "out", "--no-plots")
    document = manifest("out")
    assert called.code == 0
    assert "horizon" not in [w["code"] for w in document["warnings"]]
    assert not anew(document)
    assert document["error"]["relative"] < allowed


AT_REST = """
coordinates: {x: {}}
energy:
  kinetic: 0.705*x_dot^2/2
  potential: "if(-(x - 0.045) > 0, 118*(-(x - 0.045))^2/2, 0)"
initial: {x: 0.931, x_dot: 0}
simulation: {duration: 1.57, output_step: 0.03925}
"""
PLANET = """
parameters: {G: 6.674e-11, E: 5.972e24, m: 1000}
coordinates: {X: {}, Y: {}, x: {}, y: {}}
energy:
  kinetic: E*(X_dot^2 + Y_dot^2)/2 + m*(x_dot^2 + y_dot^2)/2
  potential: -G*E*m/sqrt((x - X)^2 + (y - Y)^2)
initial: {X: 1.5e11, Y: 0, x: 1.5e11 + 7e6, y: 0, y_dot: 7545}
simulation: {duration: 20000, output_step: 50}
"""


@pytest.mark.parametrize("text", [AT_REST, PLANET], ids=["alone", "beside"])
@pytest.mark.parametrize("method", ["auto", "dop853"])
def test_what_stays_at_rest_far_away_has_no_horizon(lagsim, write, text, method):
    """A few units in the last place of where it is are rounding, not an error."""
    path = write(text)
    called = lagsim("run", path, "--method", method, "-o", "out", "--no-plots")
    document = manifest("out")
    assert called.code == 0
    assert not anew(document)
    assert not document["warnings"]
    assert document["error"]["relative"] < 1e-9
