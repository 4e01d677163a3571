"""`lagsim explore -o` as it is typed."""

from lagsim.codes import number
from tests.studies.explore.test_explorer import OSCILLATOR


def test_what_no_file_can_hold_is_refused(lagsim, tmp_path):
    target, wall = tmp_path / "page.html", tmp_path / "wall.yaml"
    text = "constraints: {wall: {relation: x >= -1, restitution: 0.5}}\n"
    wall.write_text(OSCILLATOR + text)
    done = lagsim("explore", wall, "-o", target)
    assert done.code == 2
    assert number("not-in-a-file") in done.err
    assert "`wall`" in done.err
    assert "without -o" in done.err
    assert not target.exists()


def test_a_file_that_cannot_be_written_is_refused_before_any_work(lagsim, tmp_path):
    model = tmp_path / "oscillator.yaml"
    model.write_text(OSCILLATOR)
    for bad in (tmp_path, tmp_path / "none" / "page.html", model):
        done = lagsim("explore", model, "-o", bad)
        assert done.code == 2
        assert number("output-file") in done.err
    assert model.read_text() == OSCILLATOR
