"""Every example of README.md and docs/ is run, and prints what the page shows.

Numbers are masked by their shape: digits change with processors, words do not.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.cli._results import table
from tests.cli.conftest import lagsim  # noqa: F401
from tests.support import MODELS, ROOT

PAGES = ("README.md", *(f"docs/{p.name}" for p in sorted((ROOT / "docs").glob("*.md"))))
# Of commands on `models/*.yaml` a few models will do: the pattern is the shell's.
FEW = ("kepler", "heavy-top", "forced-oscillator")
FENCED = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
INDENTED = re.compile(r"(?:^    .*\n|^\n)+", re.MULTILINE)


@dataclass(frozen=True)
class Block:
    """A piece of a page that is set apart; `kind` is what its fence says."""

    page: str
    kind: str
    text: str


def blocks():
    found = []
    for page in PAGES:
        text = (ROOT / page).read_text(encoding="utf-8")
        found += [Block(page, kind, inside) for kind, inside in FENCED.findall(text)]
        for piece in INDENTED.findall(FENCED.sub("", text)):
            lines = [line[4:] for line in piece.split("\n")]
            if "".join(lines).strip():
                found.append(Block(page, "", "\n".join(lines).strip("\n") + "\n"))
    return found


BLOCKS = blocks()


def only(page, kind, word):
    [block] = [b for b in BLOCKS if (b.page, b.kind) == (page, kind) and word in b.text]
    return block.text


def commands(text):
    return [line for line in text.splitlines() if re.match(r"\$? ?lagsim ", line)]


def shape(text):
    """Give a text with its numbers masked, and with single spaces."""
    text = re.sub(r"[-−]?\d+(\.\d+)?(e[-+]?\d+)?", "#", text)
    text = re.sub(r"# (ms|s)\b", "# s", text)
    return re.sub(r"[ \t]+", " ", text).strip()


README_MODEL = only("README.md", "yaml", "name: pendulum-on-a-spring")


@pytest.fixture
def folder(tmp_path):
    """Lay out a folder as a reader has it: a few models, and those of the page."""
    (tmp_path / "models").mkdir()
    for name in (*FEW, "elastic-pendulum"):
        shutil.copy(MODELS / f"{name}.yaml", tmp_path / "models")
    (tmp_path / "pendulum-on-a-spring.yaml").write_text(README_MODEL)
    # "The notes print such a start": the caption's.
    caption = README_MODEL.replace("  u: l - l*theta^2\n", "  u: l\n")
    caption = caption.replace("name: pendulum-on-a-spring", "name: caption")
    assert caption != README_MODEL
    (tmp_path / "caption.yaml").write_text(caption)
    return tmp_path


def expanded(command, folder):
    """Split a command as a shell would, with its patterns and without its comment."""
    found = []
    for word in shlex.split(command, comments=True):
        files = sorted(folder.glob(word)) if "*" in word else []
        found += [str(f.relative_to(folder)) for f in files] or [word]
    return found


CONSOLE = [b for b in BLOCKS if b.kind == "console"]


@pytest.mark.parametrize("block", CONSOLE, ids=lambda b: b.text.split("\n")[0])
@pytest.mark.usefixtures("folder")
def test_consoles_print_what_is_shown(block, lagsim, tmp_path):  # noqa: F811
    first, _, shown = block.text.partition("\n")
    _, *words = expanded(first.removeprefix("$ "), tmp_path)
    called = lagsim(*words)
    assert called.code == (1 if "check caption.yaml" in first else 0)
    told = called.out + called.err
    for line, printed in zip(shown.splitlines(), told.splitlines(), strict=True):
        # Dots at the end of a line that is shown stand for the rest.
        expected, dots, _ = shape(line).partition("...")
        assert shape(printed)[: len(expected) if dots else None] == expected
    # The first lines hold no times: they are the same to the letter.
    assert told.splitlines()[0] == shown.splitlines()[0]


def test_the_repair_that_is_shown_is_the_nearest(folder, lagsim):  # noqa: F811
    shown = only("README.md", "console", "check caption.yaml")
    told = lagsim("check", "caption.yaml").out
    for name in ("theta", "u"):
        number = re.compile(rf"^ +{name}: ([\d.]+)$", re.MULTILINE)
        one, other = (float(number.search(text)[1]) for text in (shown, told))
        assert other == pytest.approx(one, rel=1e-12)
    assert (folder / "caption.yaml").exists()


def test_the_derivation_that_is_shown(lagsim, folder):  # noqa: F811
    command = only("README.md", "", "lagsim derive models/elastic-pendulum.yaml")
    shown = only("README.md", "", "Equation of θ")
    called = lagsim(*expanded(command, folder)[1:])
    assert called.code == 0
    assert shown.strip() in called.out


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
def test_goldens_as_shown(lagsim, tmp_path):  # noqa: F811
    blocks = [b.text for b in BLOCKS if (b.page, b.kind) == ("docs/ci.md", "")]
    lines = [line for text in blocks for line in commands(text)]
    assert len(lines) == 5
    for line in lines:
        called = lagsim(*expanded(line, tmp_path)[1:])
        assert called.code == 0, called.err
    stored = {p.name for p in (tmp_path / "models/golden").iterdir()}
    assert {"kepler.csv", "kepler.json"} <= stored
    assert (tmp_path / "reports/golden.xml").is_file()


SETTINGS = [b for b in BLOCKS if "pip install" in b.text and b.kind in ("yaml", "")] + [
    b for b in BLOCKS if "language: system" in b.text
]


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("number", range(len(SETTINGS)))
def test_settings_for_other_tools(number, lagsim, tmp_path):  # noqa: F811
    """Of pre-commit and GitHub: they parse, and their commands do what they are for."""
    found = []

    def walk(node):
        if isinstance(node, dict):
            for key, value in node.items():
                if key in ("run", "entry"):
                    found.append((value, node.get("files")))
                walk(value)
        elif isinstance(node, list):
            for item in node:
                walk(item)

    walk(yaml.safe_load(SETTINGS[number].text))
    own = [(c, files) for c, files in found if c.startswith("lagsim ")]
    assert own
    for command, files in own:
        words = expanded(command, tmp_path)[1:]
        if files is not None:  # pre-commit adds the files that match
            paths = [f"models/{name}.yaml" for name in FEW]
            assert all(re.search(files, path) for path in paths)
            assert not re.search(files, "README.md")
            words += paths
        if "golden" in words:
            lagsim(*words, "--update")
        assert lagsim(*words).code == 0


def test_the_module_that_is_derived(tmp_path, lagsim):  # noqa: F811
    model = MODELS / "double-pendulum.yaml"
    called = lagsim("derive", model, "--format", "python", "-o", "equations.py")
    assert called.code == 0
    code = only("docs/derive.md", "python", "from equations import")
    code += "\nprint(list(acceleration(0.0, [0.1, 0.2], [0.3, 0.4])))\n"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True, text=True, check=True, cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
    )  # fmt: skip
    found = [float(x) for x in re.findall(r"-?\d+\.\d+(?:e-?\d+)?", done.stdout)]
    # Two equal rods of length 1 and masses 1: the textbook's equations.
    text = model.read_text()
    numbers = dict(re.findall(r"^  (\w+): \{value: ([\d.]+)", text, re.MULTILINE))
    assert len(found) == 2
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


def test_the_whole_model_file_is_read(lagsim, tmp_path):  # noqa: F811
    """Every key that the page shows, with the parameters that it leaves out."""
    text = only("docs/model-file.md", "yaml", "format version")
    text = text.replace("  M: 1.0\n", "  M: 1.0\n  c: 0.1\n  F0: 1\n  w: 2\n  d: 0.1\n")
    (tmp_path / "whole.yaml").write_text(text)
    called = lagsim("check", "whole.yaml")
    assert (called.code, called.err) == (0, "")
    # What only some methods and formulations take is said to be only theirs.
    for key in ("step: 0.01", "gain: 5", "spectral_radius: 0.8"):
        text = re.sub(rf"^  {key}.*\n", "", text, flags=re.MULTILINE)
    (tmp_path / "whole.yaml").write_text(text)
    called = lagsim("run", "whole.yaml", "--duration", "0.1")
    assert called.code == 0, called.err
    files = {p.name for p in (tmp_path / "results/elastic-pendulum").iterdir()}
    assert {"trajectory.csv", "energy.png", "plot_1.png"} <= files


def test_the_laws_of_constraints_are_those_of_the_page(lagsim, tmp_path):  # noqa: F811
    text = only("docs/model-file.md", "yaml", "a freewheel")
    (tmp_path / "laws.yaml").write_text(text)
    called = lagsim("check", "laws.yaml", "--json")
    assert called.code == 0, called.err
    found = {c["name"]: c["mode"] for c in called.json["constraints"]}
    # Nothing moves; the block is held by its latch, and nothing pulls at the brake.
    assert found == {
        "floor": "sticks", "wheel": "engaged", "brake": "sticks", "latch": "in force",
    }  # fmt: skip
    assert lagsim("derive", "laws.yaml").code == 0


def test_the_reactions_are_those_of_the_page(lagsim, tmp_path):  # noqa: F811
    found = []
    for name in ("swinging", "two-rods"):
        (tmp_path / "m.yaml").write_text(only("docs/reactions.md", "yaml", name))
        assert lagsim("run", "m.yaml").code == 0
        header, rows = table(tmp_path / "results" / name)
        found.append(dict(zip(header, rows.T, strict=True)))
        assert (tmp_path / "results" / name / "plot_1.png").exists()
    r = found[0]
    said = 1.5 * 9.81 * np.cos(r["a"]) + 1.5 * 1.1 * r["a_dot"] ** 2
    assert np.allclose(r["tension"], said, rtol=1e-12)
    r = found[1]
    done = np.sum((r["drive"][1:] + r["drive"][:-1]) / 2 * np.diff(r["t"]))
    # The trapezium's error is the sum of h^3/12 of second derivatives.
    bound = 0.003 / 12 * np.sum(np.abs(np.diff(r["drive"], 2)))
    gained = r["kinetic"] + r["potential"]
    assert abs(gained[-1] - gained[0] - done) < 2 * bound < 0.01


# Blocks that other tests run: the installation by .ci/run, the gallery by
# tests/failing, the Python interface by tests/test_python, and those that are no
# examples (a formula, an output shown above).
ELSEWHERE = ("python3 -m venv", "M(q,q',t) q''", "lagsim derive MODEL", "reaction.x = ")


def test_no_block_is_forgotten():
    known = {README_MODEL, *(b.text for b in CONSOLE), *(b.text for b in SETTINGS)}
    words = (
        *ELSEWHERE, "golden models/*.yaml", "--strict models/*.yaml",
        "derive models/elastic", "format version",
        "Equation of θ", "from equations import", "a freewheel",
        "name: swinging", "name: two-rods",
    )  # fmt: skip
    left = [
        b
        for b in BLOCKS
        if b.page not in ("docs/failing.md", "docs/architecture.md")
        and (b.page, b.kind) != ("docs/python.md", "pycon")
        and b.text not in known
        and not any(word in b.text for word in words)
    ]
    assert left == []


def test_the_continuous_integration_runs_the_commands_of_the_readme():
    script = Path(ROOT / ".ci/run").read_text()
    assert "README.md" in script
    shells = [b.text for b in BLOCKS if (b.page, b.kind) == ("README.md", "sh")]
    assert len(shells) == 2
    assert all(text.count("\n") == 1 for text in shells)
