"""Every test can be collected, the slow and nightly ones too: read, not imported."""

from __future__ import annotations

import tomllib

import pytest

from tests.resolving import Project
from tests.support import ROOT


def test_every_import_mark_and_argument_of_the_tests_is_there():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    known = settings["tool"]["pytest"]["ini_options"]["markers"]
    project = Project(ROOT, frozenset(mark.split(":")[0] for mark in known))
    assert len(project.modules) > 700
    assert project.faults() == []


FILES = {
    "lagsim/__init__.py": "",
    "lagsim/room/__init__.py": "from lagsim.room.one import here\n",
    "lagsim/room/one.py": "if 1:\n    here = 1\nelse:\n    there, (*w,) = 1, (2,)\n",
    "lagsim/room/late.py": "def __getattr__(name): return name\n",
    "tests/conftest.py": "import pytest\n@pytest.fixture\ndef far(): pass\n",
    "tests/sub/near.py": "def help(): pass\n",
}
# What is written, and what is wrong with it.
FAULTLESS = [
    "from lagsim.room.one import here, there, w",
    "from lagsim.room import one, here, late\nimport lagsim.room.one as other",
    "from lagsim.room.late import anything\nfrom tests.sub import near",
    "from .near import help\nfrom ..sub.near import help as again",
    "import numpy\nfrom numpy import no_such_name",
    "@pytest.mark.slow\ndef test_a(far, tmp_path): pass",
    "@pytest.mark.parametrize('a, b', [])\ndef test_a(a, b, far, c=1): pass",
    "m = pytest.mark.parametrize(('a', 'b'), [])\n@m\ndef test_a(b, a): pass",
    "class A:\n  @pytest.fixture\n  def b(self): pass\n  def test_a(self, b): pass",
    "@given(st.text())\ndef test_a(text): pass",
]
FAULTS = {
    "from lagsim.gone import here": "test_x.py:2: there is no here of lagsim.gone",
    "from lagsim.room.one import u": "test_x.py:2: there is no u of lagsim.room.one",
    "def f():\n    try:\n        import tests.gone\n    except Exception: pass":
        "test_x.py:4: there is no tests.gone",
    "from ..near import help": "test_x.py:2: there is no help of tests.near",
    f"@pytest.mark.{'nihgtly'}\ndef test_a(): pass":
        "test_x.py: there is no mark nihgtly",
    "@pytest.mark.slow\ndef test_a(near): pass":
        "test_x.py:3: test_a: there is no fixture near",
    "@pytest.mark.parametrize('a', [])\ndef test_a(far): pass":
        "test_x.py:3: test_a uses no argument a",
    "class TestA:\n    def test_a(self, own): pass":
        "test_x.py:3: test_a: there is no fixture own",
}  # fmt: skip


def faults(folder, text):
    for name, content in {
        **FILES,
        "tests/sub/test_x.py": f"import pytest\n{text}\n",
    }.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content, encoding="utf-8")
    return Project(folder, frozenset(("slow",))).faults()


@pytest.mark.parametrize("text", FAULTLESS)
def test_what_can_be_collected_has_no_faults(tmp_path, text):
    assert faults(tmp_path, text) == []


@pytest.mark.parametrize("text", FAULTS)
def test_what_cannot_be_collected_is_found(tmp_path, text):
    assert faults(tmp_path, text) == [FAULTS[text]]
