"""`lagsim run` on constraints that hold at times: events.csv, run.json, the summary."""

import csv
import math
from pathlib import Path

import pytest

from lagsim.run import arcs
from tests.cli._results import manifest, names
from tests.small_scenes import CONTACT, ON_THE_CURVE

COLUMNS = [
    "time", "kind", "constraint", "rate_before", "rate_after", "energy", "switch",
]  # fmt: skip

# Two balls fall 1 m onto their floors and rebound with half of their speeds.
FIRST = math.sqrt(2 / 9.8)
SPEED = 9.8 * FIRST
REST = FIRST * (1 + 0.5) / (1 - 0.5)
TWO = """\
coordinates: {y: , z: }
energy: {kinetic: (y_dot^2 + z_dot^2)/2, potential: 9.8*(y + z)}
constraints:
  floor: {relation: y >= 0, restitution: 0.5}
  wall: {relation: z + 1 >= 0, restitution: 0.5}
initial: {y: 1, z: 0}
simulation: {duration: 1, output_step: 0.05}
"""
ENDLESS = """\
coordinates: {y: }
energy: {kinetic: y_dot^2/2, potential: 9.8*y}
constraints: {floor: {relation: y >= 0, restitution: 1}}
initial: {y: 1}
simulation: {duration: 20, output_step: 0.5}
"""


def listed():
    with Path("out/events.csv").open(newline="") as file:
        rows = csv.reader(file)
        assert next(rows) == COLUMNS
        return list(rows)


def test_events_are_listed_like_rows(lagsim, write):
    lagsim("run", write(CONTACT), "--no-plots", "-o", "out", code=0)
    assert names("out") == ["events.csv", "run.json", "trajectory.csv"]
    document = manifest("out")
    assert document["files"] == ["trajectory.csv", "events.csv", "run.json"]
    assert Path("out/events.csv").read_bytes().endswith(b"\r\n")
    time, kind, constraint, *numbers, switch = listed()[0]
    assert (kind, constraint, switch) == ("impact", "floor", "")
    assert float(time) == pytest.approx(FIRST, rel=1e-12)
    assert numbers == [repr(float(text)) for text in numbers]
    before, after, energy = map(float, numbers)
    assert before == pytest.approx(-SPEED, rel=1e-10)
    assert after == pytest.approx(SPEED / 2, rel=1e-10)
    assert energy == pytest.approx(-9.8 * 3 / 4, rel=1e-10)


def test_every_event_is_in_both_files(lagsim, write):
    lagsim("run", write(TWO), "--no-plots", "-o", "out")
    events = manifest("out")["events"]
    assert len(events) == sum(manifest("out")["event_counts"].values())
    told = [["" if e[c] is None else str(e[c]) for c in COLUMNS] for e in events]
    assert told == listed()
    times = [e["time"] for e in events]
    assert times == sorted(times)
    # What strikes at one time is a line each.
    first, second = listed()[:2]
    assert [first[2], second[2]] == ["floor", "wall"]
    for line in (first, second):
        assert float(line[0]) == pytest.approx(FIRST, rel=1e-12)
        # The change by both of them.
        assert float(line[5]) == pytest.approx(-2 * 9.8 * 3 / 4, rel=1e-10)


@pytest.mark.slow
def test_no_such_file_without_such_constraints(lagsim, write):
    lagsim("run", write(CONTACT), "--no-plots", "-o", "out")
    called = lagsim("run", write(ON_THE_CURVE), "--no-plots", "-o", "out")
    assert names("out") == ["run.json", "trajectory.csv"]
    assert "  events " not in called.out


@pytest.mark.slow
def test_the_summary_counts_impacts_and_tells_of_rest(lagsim, write):
    text = TWO.replace("duration: 1,", "duration: 2,")
    called = lagsim("run", write(text), "--no-plots", "-o", "out")
    lines = called.out.splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith("  events"))
    count = sum(line[1] == "impact" for line in listed())
    assert lines[at].split()[1:] == [str(count), "impacts", "at", "`floor`,", "`wall`"]
    rest = f"at rest from t = {REST:.9g}: `floor`, `wall`"
    assert lines[at + 1].strip() == rest
    assert max(len(line) for line in lines[at : at + 2]) <= 80
    assert "2 coordinates, 2 contacts" in called.out


@pytest.mark.slow
@pytest.mark.parametrize("most", [3, 5])
def test_what_is_not_listed_is_told(lagsim, write, monkeypatch, most):
    monkeypatch.setattr(arcs, "MOST_EVENTS", most)
    # At sqrt(2 h/g) times 1, 3, 5, ... up to 20.
    impacts = [FIRST * k for k in range(1, 100, 2) if FIRST * k < 20]
    lost = len(impacts) - most
    called = lagsim("run", write(ENDLESS), "--no-plots", "-o", "out")
    assert [float(line[0]) for line in listed()] == pytest.approx(impacts)
    kept = [event["time"] for event in manifest("out")["events"]]
    assert kept == pytest.approx(impacts[:most])
    assert manifest("out")["event_counts"] == {"impact": len(impacts)}
    [warning] = manifest("out")["warnings"]
    assert warning["code"] == "events-unlisted"
    assert f"the first {most} events" in warning["text"]
    assert f"t = {impacts[most]:.9g} " in warning["text"]
    assert f"{lost} of kind impact" in warning["text"]
    took = impacts[most] - impacts[0]
    assert (
        f"{most} of the last {most} listed are at `floor`, within {took:.3g} of time"
        in warning["text"]
    )
    assert warning["text"] in called.err
    assert f"{len(impacts)} impacts at `floor`" in called.out
    # What a run has once is listed all the same.
    until = ENDLESS.replace("0.5}", "0.5, until: y_dot >= 20 - t}")
    lagsim("run", write(until), "--no-plots", "-o", "out", "-q")
    kinds = [event["kind"] for event in manifest("out")["events"]]
    assert kinds == [*["impact"] * most, "until"]
    assert [line[1] for line in listed()][-2:] == ["impact", "until"]
    assert len(listed()) == sum(manifest("out")["event_counts"].values())


@pytest.mark.slow
def test_events_are_in_the_file_while_the_run_goes_on(lagsim, write, monkeypatch):
    """Where rows are passed on, the file has the events before the last row."""
    part, found = Path("out/.lagsim-events.csv.part"), []
    pass_on = arcs.Recorder.pass_on

    def looked_at(self):
        pass_on(self)
        lines = part.read_text().splitlines()[1:]
        earlier = [x for x in self.events if x.time < self.last]
        assert [float(line.split(",")[0]) for line in lines] == [
            event.time for event in earlier
        ]
        found.append(len(lines))

    monkeypatch.setattr(arcs.Recorder, "pass_on", looked_at)
    monkeypatch.setattr(arcs, "POOLED_ROWS", 4)
    more = ("--no-plots", "--error-bar", "never", "-o", "out", "-q")
    assert lagsim("run", write(ENDLESS), *more).code == 0
    assert found[-1] > 10
    assert len(set(found)) > 10


@pytest.mark.slow
def test_the_table_is_the_same_without_pictures(lagsim, write):
    """Pictures need further rows beside events, which are not in the table."""
    model = write(CONTACT)
    found = []
    for options in ((), ("--no-plots",)):
        assert lagsim("run", model, "-o", "out", *options).code == 0
        document = manifest("out")
        kept = [document[key] for key in ("rows", "end", "events", "energy_drift")]
        found.append((Path("out/trajectory.csv").read_bytes(), kept))
    assert found[0] == found[1]


# A block of 1 kg on a spring of 100 N/m that dry friction of 1.962 N brakes, let go at
# 0.2 m: after half swings of pi/10 s it turns at -0.16076, 0.12152, -0.08228, 0.04304
# and -0.0038 m, where the spring is weaker than the friction (Den Hartog, 8.4).
BRAKED = """\
parameters: {{mu: 0.2, g: 9.81}}
coordinates: {{x: }}
definitions: {{friction: -mu*g*sign(x_dot)}}
energy: {{kinetic: x_dot^2/2, potential: 50*x^2}}
forces: {{x: {force}}}
initial: {{x: 0.2}}
simulation: {{duration: 2, output_step: 0.1}}
{more}"""
FRICTIONS = [
    ("friction", "sign(x_dot)"),
    ('"if(x_dot > 0, -1.962, 1.962)"', "if(x_dot > 0, ...)"),
    ("-1.962*(2*heaviside(x_dot) - 1)", "heaviside(x_dot)"),
]


@pytest.mark.parametrize(("force", "switch"), FRICTIONS)
def test_friction_written_as_a_force_is_listed(lagsim, write, force, switch):
    text = BRAKED.format(force=force, more="")
    called = lagsim("run", write(text), "--no-plots", "-o", "out")
    assert names("out") == ["events.csv", "run.json", "trajectory.csv"]
    kinds = ["switch"] * 4 + ["stick"]
    for k, (line, kind) in enumerate(zip(listed(), kinds, strict=True), 1):
        assert float(line[0]) == pytest.approx(k * math.pi / 10, rel=1e-9)
        assert (line[1], line[-1]) == (kind, switch)
        assert line[2:-1] == ["", "", "", ""]
    assert f"  events        1 stick, 4 switches at `{switch}`\n" in called.out


@pytest.mark.parametrize(
    ("text", "duration"),
    [
        (CONTACT, "duration: 1"),
        (BRAKED.format(force="friction", more=""), "duration: 2"),
    ],
)
def test_the_summary_where_nothing_happens(lagsim, write, text, duration):
    short = text.replace(duration, "duration: 0.1")
    called = lagsim("run", write(short), "--no-plots", "-o", "out")
    assert "  events        none\n" in called.out
    assert listed() == []
