"""The energy balance as a verdict: rejected rows are computed again, or not valid."""

import pytest

from tests.cli._results import manifest, table
from tests.scenes.test_change_point import LINKAGE


def anew(document):
    """Return the choices by which a run was repeated."""
    return [c for c in document["plan"] if c["choice"].startswith("repeated: ")]


def column(folder, name):
    header, rows = table(folder)
    return rows[:, header.index(name)]


HILL = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: "10*exp(-(x/0.1)^2)"}
initial: {x: -5, x_dot: 1}
simulation: {duration: 10, output_step: STEP}
"""


@pytest.mark.slow
def test_what_was_made_anew_is_told(lagsim, write):
    """The table and the pictures have the rows of the second attempt alone."""
    called = lagsim("run", write(HILL.replace("STEP", "5")), "-o", "out")
    document = manifest("out")
    t = column("out", "t")
    assert t.tolist() == [0.0, 5.0, 10.0]
    assert document["rows"] == 3
    for choice in anew(document):
        assert choice["choice"] in called.out
        assert "taylor" in choice["reason"]
        assert document["method"] == "dop853"


@pytest.mark.slow
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
    called = lagsim(
        "run", write(fall), "--method", method, "-o", "out", "--no-plots", code=3
    )
    assert "x = " in called.err
    assert "`work`" not in called.err
    assert f"--method {method}" not in called.err
    if method == "auto":
        assert "--method" not in called.err


@pytest.mark.slow
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


def test_without_an_error_bar_nothing_is_repeated(lagsim, write):
    path = write(HILL.replace("STEP", "5"))
    asked = "--error-bar", "never", "--no-plots"
    called = lagsim("run", path, "-o", "out", *asked, code=3)
    assert not anew(manifest("out"))
    assert called.reports("E508", "t = 5 ")
