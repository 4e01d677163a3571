"""docs/failing.md: its commands run, and raise the alarms that it names."""

import json
import re
import shlex
from pathlib import Path

import pytest

from tests.cli.conftest import lagsim  # noqa: F401
from tests.support import MODELS, ROOT

PAGE = (ROOT / "docs" / "failing.md").read_text(encoding="utf-8")
SECTIONS = {
    part.split("\n")[0]: part
    for part in re.split(r"^### ", PAGE, flags=re.MULTILINE)[1:]
}
SCENES = sorted(path.name for path in (MODELS / "failing").glob("*.yaml"))


def commands(text):
    return [
        shlex.split(line)[1:]
        for line in re.findall(r"^ +lagsim .*$", text, flags=re.MULTILINE)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("title", SECTIONS)
def test_each_section_does_what_it_says(lagsim, title):  # noqa: F811
    section = SECTIONS[title].split("\n## ")[0]
    found = set()
    assert commands(section)
    for command, model, *options in commands(section):
        plots = ["--no-plots"] if command == "run" else []
        called = lagsim(command, ROOT / model, *options, *plots, "-o", "out")
        assert called.code == 0, called.err
        if command == "run":
            document = json.loads(Path("out/run.json").read_text())
            found |= {warning["code"] for warning in document["warnings"]}
    told = re.search(r"Alarms?: ([^.]*)\.", section.replace("\n", " "))
    named = set(re.findall(r"`([a-z-]+)`", told[1])) if told else set()
    # The horizon comes with whatever is wrong: it is named where it is all there is.
    assert found - {"horizon"} == named - {"horizon"}
    assert named <= found


@pytest.mark.parametrize("name", SCENES)
def test_each_scene_says_what_it_is_for(lagsim, name):  # noqa: F811
    text = (MODELS / "failing" / name).read_text(encoding="utf-8")
    header = text.split("\n\n")[0]
    for word in ("What fails:", "Alarm", "Source:", "Units:", "Expect:"):
        assert word in header
    assert commands(header.replace("#", " "))
    assert name in PAGE
    assert lagsim("check", MODELS / "failing" / name).code == 0


def test_pictures_are_there_and_small():
    for picture in re.findall(r"\]\((failing/[a-z]+\.png)\)", PAGE):
        assert 2_000 < (ROOT / "docs" / picture).stat().st_size < 60_000
    drawn = {path.name for path in (ROOT / "docs" / "failing").iterdir()}
    assert drawn == {Path(p).name for p in re.findall(r"failing/[a-z]+\.png", PAGE)}
