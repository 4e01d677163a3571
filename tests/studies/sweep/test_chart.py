"""The picture of a sweep: what stands where."""

from __future__ import annotations

import gc

import numpy as np
import pytest
from matplotlib.figure import Figure

from lagsim.model.reader import read
from lagsim.run.interrupt import Interrupt
from lagsim.studies.attempts import ErrorBars
from lagsim.studies.sweep import chart as drawing
from lagsim.studies.sweep.runs import Found, Runs, parsed
from lagsim.studies.sweep.sweeping import sweep
from tests.outputs.drawn import assert_legible, drawn, noted
from tests.small_scenes import FALL, ON_THE_CURVE, PENDULUM

LONG = PENDULUM.replace("theta", "a" * 40).replace("g:", "b: 1, g:", 1)


def found(text, *arguments, ends=False):
    model = read(text, "<model>")
    result = Found.of(model, parsed(model, arguments), {}, ErrorBars.NEVER, ends=ends)
    sweep(result, 1, wanted=False)
    return result


def test_values_are_those_of_complete_runs():
    text = "parameters: {R: 1}\n" + FALL.replace("{r: 1}", "{r: R}")
    result = found(text, "R=1,5,0")  # it falls in; it does not; no start
    cells = drawing.values_of(result, "r")
    assert np.isnan(cells[[0, 2]]).all()
    end, low, high = cells[1]
    assert high == 5.0
    assert low == end < 5.0


def test_maps_have_the_first_names_across_and_up_and_others_in_their_middle():
    result = found(PENDULUM, "g=1,2", "theta=0.1,0.2,0.3", "l=1,2,3,4", "theta_dot=0")
    numbers = drawing.numbers_of(result)
    assert numbers.shape == (2, 3)
    for (i, j), number in np.ndenumerate(numbers):
        assert result.grid.at(number) == [i, j, 1, 0]


@pytest.mark.parametrize(
    ("values", "edges"),
    [
        ([1.0, 2.0, 4.0], [0.5, 1.5, 3.0, 5.0]),
        ([3.0], [1.5, 4.5]),
        ([0.1, 1.0, 10.0], [10**-1.5, 10**-0.5, 10**0.5, 10**1.5]),
    ],
)
def test_cells_end_half_way(values, edges):
    assert drawing.borders(np.array(values)) == pytest.approx(edges)


@pytest.mark.parametrize(
    ("text", "arguments"),
    [
        (PENDULUM, ("g=5:10:3",)),
        (PENDULUM, ("g=1,10,100", "theta=0.1,0.2")),
        (PENDULUM, ("g=1", "theta=0.1", "l=1,2")),
        (ON_THE_CURVE, ("u=0.3,0.4",)),  # no start is admissible
        (ON_THE_CURVE, ("u=0.3,0.4", "K=1,2")),
        (LONG, ("b=1,10,100", f"{'a' * 40}=1,2")),
        (LONG, (f"{'a' * 40}=1,2",)),
    ],
)
def test_every_text_of_every_sweep_lies_on_the_sheet_and_over_no_other(text, arguments):
    seen = drawn(drawing.chart, found(text, *arguments))
    assert seen.sheet.startswith(b"\x89PNG")
    assert_legible(seen)


def test_a_start_value_is_called_so_and_ends_are_points():
    result = found(PENDULUM, "theta=0.1,0.3,0.2,0.4")
    with noted() as seen:
        drawing.chart(result)
    assert "θ at the start (rad)" in [panel.labels[0] for panel in seen.panels]
    [ends] = seen.panels[0].lines
    assert ends.dots
    assert len(ends.x) == 4
    assert {"at the end", "from least to greatest"} <= set(seen.written())
    # What is a parameter is no start value.
    with noted() as seen:
        drawing.chart(found(PENDULUM, "g=1,2"))
    assert not any("start" in text for text in seen.written())


def test_ends_alone_have_no_greatest():
    for arguments in (("theta=0.1,0.2",), ("theta=0.1,0.2", "g=1,2")):
        result = found(PENDULUM, *arguments, ends=True)
        with noted() as seen:
            drawing.chart(result)
        assert not any("greatest" in text for text in seen.written())
        assert any("at the end" in text for text in seen.written())


@pytest.mark.slow
def test_pictures_of_kept_runs_do_not_pile_up(tmp_path):
    """Each takes megabytes, and commands collect no garbage unasked."""
    model = read(PENDULUM, "m.yaml", {}, {"duration": "0.1"})
    names = [f"{p.name}=1:2:6" for p in model.parameters[:1]]
    grid, options = parsed(model, names), {"duration": "0.1"}
    bars = ErrorBars.NEVER
    runs = Runs(
        Found.of(model, grid, options, bars, kept=str(tmp_path), plots=True).work
    )
    gc.collect()
    gc.disable()
    try:
        for number in range(grid.runs):
            assert runs.row(number, Interrupt()) is not None
        left = sum(isinstance(x, Figure) for x in gc.get_objects())
    finally:
        gc.enable()
    drawn = len(list(tmp_path.rglob("*.png")))
    assert left <= drawn / grid.runs < drawn
