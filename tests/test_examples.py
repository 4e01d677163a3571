"""Examples of README.md, docs/ and docstrings are run, and print the text shown.

A page is read from top to bottom, in one folder: its models are written there, its
commands called, one after the other. The kind of a fence decides: `yaml` with
coordinates is a model, `console` shows the output of its commands, `sh` does not,
`python` and `pycon` are programs; `text`, `csv`, `json` and `latex` are no examples.
Numbers are masked by their shape: digits change with processors, words do not.
"""

import doctest
import importlib
import json
import re
import shutil
import subprocess
import sys
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
import yaml

import lagsim as house
from lagsim.model.reader import schema
from tests.cli._results import table
from tests.cli.conftest import lagsim  # noqa: F401
from tests.pages import PAGES, blocks, commands, indented, text_of, words_of
from tests.support import MODELS, ROOT

BLOCKS = [block for page in PAGES for block in blocks(page)]
# Of commands on `models/*.yaml` a few models will do: the pattern is the shell's.
FEW = ("kepler", "heavy-top", "forced-oscillator")
KINDS = {"yaml", "console", "sh", "python", "pycon", "text", "csv", "json", "latex"}

# Pages that other tests run.
ELSEWHERE = {
    "docs/failing.md": "tests/scenes/failing/test_gallery.py",
    "docs/gallery.md": "tests/test_site.py; tests/golden run its models",
    "docs/python.md": "tests/test_python.py",
    "docs/recipes.md": "tests/test_recipes.py",
}
# Commands that are not run here, by their first words, and why.
NOT_RUN = {
    "python3 -m venv": ".ci/run runs it in a fresh clone",
    "pip install": "needs the network",
    "lagsim explore": "serves until Ctrl-C; tests/studies/explore opens its page",
    "python benchmarks/": "measures for minutes",
    "python -m benchmarks.": "writes files of the repository",
}
# Pages whose examples take more than a second or two.
SLOW = {
    f"docs/{name}.md" for name in ("animation", "ci", "commands", "sweeps", "tutorial")
}
# Starts that are shown to be refused.
REFUSED = {"caption", "swing"}
GUIDE = "docs/guide.md"


def only(page, kind, word):
    [block] = [b for b in BLOCKS if (b.page, b.kind) == (page, kind) and word in b.text]
    return block.text


def shape(text):
    """Return a text with its numbers masked, and with single spaces."""
    text = re.sub(r"[-−]?\d+(\.\d+)?(e[-+]?\d+)?", "#", text)
    text = re.sub(r"# (ms|s)\b", "# s", text)
    return re.sub(r"[ \t]+", " ", text).strip()


def is_model(block):
    return block.kind == "yaml" and "\ncoordinates:" in f"\n{block.text}"


def is_part(block):
    """Whether a block is a part of a model, to be written into a model file."""
    if block.kind != "yaml" or is_model(block):
        return False
    keys = schema({})["properties"]
    return all(key in keys for key in yaml.safe_load(block.text))


PARTS = [b for b in BLOCKS if is_part(b) and b.page not in ELSEWHERE]
SETTINGS = [
    b for b in BLOCKS if b.kind == "yaml" and not is_model(b) and not is_part(b)
]


@pytest.fixture
def folder(tmp_path):
    """Lay out a folder as a reader has it, with some of the shipped models."""
    (tmp_path / "models").mkdir()
    named = {
        name
        for page in PAGES
        for block in blocks(page)
        if page not in ELSEWHERE
        for name in re.findall(r"\bmodels/([\w-]+)\.yaml", block.text)
    }
    for name in {*FEW, *named}:
        for path in MODELS.glob(f"{name}.*"):
            shutil.copy(path, tmp_path / "models")
    return tmp_path


class Reader:
    """Execution of the blocks of a page, one by one."""

    def __init__(self, call, folder):
        self.call = call
        self.folder = folder
        self.names = {}
        self.refused = False  # the start of the model that was shown last

    def read(self, block):
        if is_model(block):
            self.model(block.text)
        elif block.kind in ("console", "sh"):
            for command, shown in commands(block):
                self.command(command, shown)
        elif block.kind == "python":
            exec(compile(block.text, block.page, "exec"), self.names)
        elif block.kind == "pycon":
            self.session(block)

    def model(self, text):
        model = house.load(text)
        self.refused = model.name in REFUSED
        (self.folder / f"{model.name}.yaml").write_text(text, encoding="utf-8")
        try:
            result = house.simulate(model, duration=0.1, error_bar="never")
        except house.InadmissibleError:
            assert self.refused
        else:
            assert result.complete, result.reason
            self.refused = False

    def command(self, command, shown):
        if any(command.startswith(begins) for begins in NOT_RUN):
            return
        if command.startswith("printf "):  # a small file for the next command
            subprocess.run(["sh", "-c", command], cwd=self.folder, check=True)
            return
        program, *words = words_of(command, self.folder)
        assert program == "lagsim", f"who runs `{command}`?"
        called = self.call(*words)
        assert called.code == (1 if self.refused else 0), called.err
        if shown:
            shows(called.out + called.err, shown)

    def session(self, block):
        test = doctest.DocTestParser().get_doctest(
            block.text, self.names, block.page, None, 0
        )
        runner, told = doctest.DocTestRunner(), []
        runner.run(test, out=told.append, clear_globs=False)
        assert runner.failures == 0, "".join(told)
        self.names = test.globs


def shows(told, shown):
    """Compare the printed text with that of a page; dots stand for omitted parts."""
    lines, printed = shown.rstrip("\n").splitlines(), told.splitlines()
    if lines[-1].strip() == "...":
        lines.pop()
        printed = printed[: len(lines)]
    for line, other in zip(lines, printed, strict=True):
        expected, dots, _ = shape(line).partition("...")
        assert shape(other)[: len(expected) if dots else None] == expected
    # The first lines hold no times: they are the same to the letter.
    if "..." not in lines[0]:
        assert printed[0] == lines[0]


def _param(page):
    marks = [pytest.mark.slow] if page in SLOW else []
    return pytest.param(page, marks=marks, id=page)


@pytest.mark.parametrize("page", [_param(p) for p in PAGES if p not in ELSEWHERE])
def test_a_page_does_what_it_shows(page, lagsim, folder, monkeypatch):  # noqa: F811
    monkeypatch.syspath_prepend(folder)  # modules that a page writes
    reader = Reader(lagsim, folder)
    for block in blocks(page):
        reader.read(block)
    sys.modules.pop("equations", None)


# Modules whose docstrings have examples: `lagsim.api` for `lagsim/api/__init__.py`.
DOCTESTS = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for path in sorted((ROOT / "lagsim").rglob("*.py"))
    if ">>> " in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("name", DOCTESTS)
def test_the_examples_of_docstrings_return_the_values_shown(name):
    runner, told = doctest.DocTestRunner(), []
    tests = doctest.DocTestFinder().find(importlib.import_module(name))
    assert any(test.examples for test in tests), "no docstring has these"
    for test in tests:
        runner.run(test, out=told.append)
    assert runner.failures == 0, "".join(told)


def test_every_public_function_has_an_example():
    shown = [x for name in house.__all__ if callable(x := getattr(house, name))]
    without = [x.__name__ for x in shown if ">>> " not in (x.__doc__ or "")]
    assert without == []


def test_no_block_is_forgotten():
    unknown = [b.name for b in BLOCKS if b.kind not in KINDS]
    assert unknown == []
    # What four blanks set apart says not what it is: a fence does.
    loose = {page: indented(page) for page in PAGES if page not in ELSEWHERE}
    assert {page: found for page, found in loose.items() if found} == {}
    # What is not run holds no command that could be.
    idle = [b.name for b in BLOCKS if b.kind == "text" and "$ lagsim" in b.text]
    assert idle == []


def test_the_pages_that_others_run_are_there():
    for page, why in ELSEWHERE.items():
        assert page in PAGES
        test = ROOT / why.partition(";")[0]
        assert page in test.read_text() or page.rpartition("/")[2] in test.read_text()


# --- what single examples say ---------------------------------------------------------


def test_the_repair_that_is_shown_is_the_nearest(folder, lagsim):  # noqa: F811
    (folder / "caption.yaml").write_text(only(GUIDE, "yaml", "name: caption"))
    shown = only(GUIDE, "console", "check caption.yaml")
    told = lagsim("check", "caption.yaml").out
    for name in ("theta", "u"):
        number = re.compile(rf"^ +{name}: ([\d.]+)$", re.MULTILINE)
        one, other = (float(number.search(text)[1]) for text in (shown, told))
        assert other == pytest.approx(one, rel=1e-12)


def test_the_tutorial_shows_the_template(lagsim):  # noqa: F811
    lagsim("new", "pendulum")
    lines = Path("pendulum.yaml").read_text(encoding="utf-8").splitlines()
    plain = [line.partition("#")[0].rstrip() for line in lines]
    shown = only("docs/tutorial.md", "yaml", "Phase plane")
    assert shown.splitlines() == [line for line in plain if line]


@pytest.mark.parametrize("page", ["docs/tutorial.md", "docs/errors.md"])
def test_the_fault_that_is_shown(page, lagsim):  # noqa: F811
    lagsim("new", "pendulum")
    path = Path("pendulum.yaml")
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("sin(theta)", "sin theta"), encoding="utf-8")
    called = lagsim("check", "pendulum.yaml")
    assert (called.code, called.out) == (2, "")
    assert called.err == only(page, "text", "pendulum.yaml:20:20")


@pytest.mark.parametrize("block", PARTS, ids=lambda b: b.name)
def test_parts_of_models_are_valid_in_the_template(block, lagsim):  # noqa: F811
    lagsim("new", "pendulum")
    path = Path("pendulum.yaml")
    model = yaml.safe_load(path.read_text(encoding="utf-8"))
    for key, part in yaml.safe_load(block.text).items():
        assert set(part) <= set(model[key])
        model[key].update(part)
    path.write_text(yaml.safe_dump(model, sort_keys=False), encoding="utf-8")
    called = lagsim("check", "pendulum.yaml")
    assert called.code == 0, called.err


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("block", SETTINGS, ids=lambda b: b.name)
def test_settings_for_other_tools(block, lagsim, tmp_path):  # noqa: F811
    """Settings of pre-commit and GitHub can be parsed, and their commands work."""
    found = [
        (node[key], node.get("files"))
        for node in _mappings(yaml.safe_load(block.text))
        for key in ("run", "entry")
        if key in node
    ]
    own = [(c, files) for c, files in found if c.startswith("lagsim ")]
    assert own
    for command, files in own:
        words = words_of(command, tmp_path)[1:]
        if files is not None:  # pre-commit adds the files that match
            paths = [f"models/{name}.yaml" for name in FEW]
            assert all(re.search(files, path) for path in paths)
            assert not re.search(files, "README.md")
            words += paths
        if "golden" in words:
            lagsim(*words, "--update")
        assert lagsim(*words).code == 0


def _mappings(node):
    if isinstance(node, dict):
        yield node
    for below in node.values() if isinstance(node, dict) else node:
        if isinstance(below, dict | list):
            yield from _mappings(below)


def test_the_module_that_is_derived(tmp_path, monkeypatch, lagsim):  # noqa: F811
    model = MODELS / "double-pendulum.yaml"
    called = lagsim("derive", model, "--format", "python", "-o", "equations.py")
    assert called.code == 0
    monkeypatch.syspath_prepend(tmp_path)
    names = {}
    exec(only("docs/derive.md", "python", "from equations import"), names)
    monkeypatch.delitem(sys.modules, "equations")
    found = names["acceleration"](0.0, [0.1, 0.2], [0.3, 0.4])
    # Two rods with masses at their ends: the textbook's equations.
    numbers = dict(
        re.findall(r"^  (\w+): \{value: ([\d.]+)", model.read_text(), re.MULTILINE)
    )
    assert np.allclose(found, double_pendulum(numbers), rtol=1e-12)


def double_pendulum(numbers):
    m1, m2, l1, l2, g = (float(numbers[k]) for k in ("m1", "m2", "l1", "l2", "g"))
    a, b, va, vb = 0.1, 0.2, 0.3, 0.4
    c, s = np.cos(a - b), np.sin(a - b)
    M = [[(m1 + m2) * l1**2, m2 * l1 * l2 * c], [m2 * l1 * l2 * c, m2 * l2**2]]
    f = [
        -m2 * l1 * l2 * s * vb**2 - (m1 + m2) * g * l1 * np.sin(a),
        m2 * l1 * l2 * s * va**2 - m2 * g * l2 * np.sin(b),
    ]
    return np.linalg.solve(M, f)


def test_the_whole_model_file_is_whole():
    """Every key that the reader knows stands in the guide's last model."""
    text = only(GUIDE, "yaml", "format version")
    schema = json.loads((ROOT / "lagsim/lagsim.schema.json").read_text())
    assert [key for key in schema["properties"] if f"\n{key}:" not in text] == []
    for section in ("energy", "simulation", "scene", "output"):
        keys = schema["properties"][section]["properties"]
        assert [k for k in keys if not re.search(rf"\b{k}:", text)] == []


@pytest.mark.slow
def test_the_whole_model_file_is_run(folder, lagsim):  # noqa: F811
    text = only(GUIDE, "yaml", "format version")
    # These sensitivities take five times as long as all else.
    short = text.replace("  sensitivities: [l, theta]\n", "")
    assert short != text
    (folder / "whole.yaml").write_text(short)
    called = lagsim("run", "whole.yaml", "--duration", "0.1")
    assert called.code == 0, called.err
    files = {p.name for p in (folder / "results/elastic-pendulum").iterdir()}
    assert {"trajectory.csv", "energy.png", "plot_1.png"} <= files


def test_the_laws_of_constraints_are_those_of_the_page(folder, lagsim):  # noqa: F811
    text = only(GUIDE, "yaml", "a freewheel")
    (folder / "laws.yaml").write_text(text)
    called = lagsim("check", "laws.yaml", "--json")
    assert called.code == 0, called.err
    found = {c["name"]: c["mode"] for c in called.json["constraints"]}
    # Nothing moves; the block is held by its latch, and nothing pulls at the brake.
    assert found == {
        "floor": "sticks", "wheel": "engaged", "brake": "sticks", "latch": "in force",
    }  # fmt: skip
    assert lagsim("derive", "laws.yaml").code == 0


@pytest.mark.slow
def test_the_reactions_are_those_of_the_page(lagsim, tmp_path):  # noqa: F811
    found = []
    for name in ("swinging", "two-rods"):
        (tmp_path / "m.yaml").write_text(only("docs/reactions.md", "yaml", name))
        assert lagsim("run", "m.yaml", "--no-plots").code == 0
        header, rows = table(tmp_path / "results" / name)
        found.append(dict(zip(header, rows.T, strict=True)))
    r = found[0]
    said = 1.5 * 9.81 * np.cos(r["a"]) + 1.5 * 1.1 * r["a_dot"] ** 2
    assert np.allclose(r["tension"], said, rtol=1e-12)
    r = found[1]
    done = np.sum((r["drive"][1:] + r["drive"][:-1]) / 2 * np.diff(r["t"]))
    # The trapezium's error is the sum of h^3/12 of second derivatives.
    bound = 0.003 / 12 * np.sum(np.abs(np.diff(r["drive"], 2)))
    gained = r["kinetic"] + r["potential"]
    assert abs(gained[-1] - gained[0] - done) < 2 * bound < 0.01


def test_what_is_compared_was_measured():
    """The README's times are those of the benchmarks' tables, with two digits."""
    text = text_of("README.md")
    part = text.partition("## How it compares\n")[2].partition("\n## ")[0]
    measured = "".join(
        (ROOT / "benchmarks" / name).read_text(encoding="utf-8")
        for name in ("results.md", "results-rivals.md")
    )
    cells = re.findall(r"(?<=[|:]) (\d[\d.]*(?:e\+\d+)?)(?= \|)", measured)
    known = {f"{Decimal(x):.1e}" for x in cells}
    times = re.findall(r"\| ([\d.]+) \| \w+: ([\d.]+) \|", part)
    assert len(times) > 5
    assert {f"{Decimal(x):.1e}" for pair in times for x in pair} <= known
    seconds = re.findall(r"\b(\d+\.\d+) s\b", part)
    assert len(seconds) == 2
    assert {f"{1000 * Decimal(x):.1e}" for x in seconds} <= known
    for number in [x for pair in times for x in pair] + seconds:
        assert len(number.replace(".", "").lstrip("0")) <= 2


def test_the_continuous_integration_runs_the_commands_of_the_readme():
    script = (ROOT / ".ci/run").read_text()
    assert "README.md" in script
    shells = [b.text for b in BLOCKS if (b.page, b.kind) == ("README.md", "sh")]
    assert len(shells) == 2
    assert all(text.count("\n") == 1 for text in shells)
