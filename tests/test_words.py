"""Words that docs, help and models avoid: riddles, personification, house slang.

A program reports; it does not say or tell. A constraint is satisfied, not met. `scene`
is the section of a model file; everything else is a model. Code and outputs are left
out here: they are the program's messages, which tests/codes looks at.
"""

import re

import pytest

from lagsim.cli import COMMANDS
from tests.cli.conftest import lagsim  # noqa: F401
from tests.pages import PAGES, prose
from tests.support import ROOT

AVOIDED = re.compile(
    r"\b(told|said|made anew|ledgers?|met|stands? for|stood for"
    r"|(?<!to )(?<!at )rest on|rest upon|rests (?:up)?on|rested on)\b",
    re.IGNORECASE,
)
# The section of a model file, and what is in it.
THE_SECTION = (
    "points? of the scene", "section scene", "without a scene", "scene's points",
    "in the scene", "a scene point", "for the scene", "has a scene", "neither a scene",
)  # fmt: skip
SCENE = re.compile(r"\bscenes?\b", re.IGNORECASE)
PICTURED = "models/*.yaml", "models/failing/*.yaml", "lagsim/cli/templates/*.yaml"
HEADERS = [str(p.relative_to(ROOT)) for g in PICTURED for p in sorted(ROOT.glob(g))]
MEASURED = sorted(p.relative_to(ROOT) for p in (ROOT / "benchmarks").glob("*.md"))
TEXTS = [*PAGES, "SECURITY.md", *map(str, MEASURED)]


def avoided(text):
    """Return the words of a text that are to be avoided."""
    text = " ".join(re.sub(r"`[^`]*`", "", text).split())
    found = [hit[0] for hit in AVOIDED.finditer(text)]
    for phrase in THE_SECTION:
        text = re.sub(phrase, "", text)
    return found + SCENE.findall(text)


@pytest.mark.parametrize("page", TEXTS)
def test_pages_avoid_these_words(page):
    assert avoided(prose(page)) == []


@pytest.mark.parametrize("path", HEADERS)
def test_models_avoid_these_words(path):
    text = (ROOT / path).read_text(encoding="utf-8")
    comments = re.findall(r"(?m)(?:^|\s)#(.*)$", text)
    texts = re.findall(r"(?m)description: (.*)$", text)
    assert avoided(" ".join([*comments, *texts])) == []


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_avoids_these_words(command, lagsim):  # noqa: F811
    shown = lagsim(*command.split(), "--help").out
    assert "Usage" in shown
    assert avoided(re.sub(r"[│╭╰─]", " ", shown)) == []
