"""`lagsim new`: files to begin from."""

import tomllib

import pytest

from tests.support import ROOT

FOLDER = ROOT / "lagsim/cli/templates"
TEMPLATES = (
    "pendulum", "holonomic", "nonholonomic", "contact", "forced", "linkage",
    "rigid-body",
)  # fmt: skip
# Degrees of freedom, and the kind of the constraints, by counting.
STRUCTURE = {
    "pendulum": (1, set()), "holonomic": (1, {"holonomic"}),
    "nonholonomic": (2, {"nonholonomic"}), "contact": (2, {"one-sided"}),
    "forced": (1, set()), "linkage": (1, {"holonomic"}), "rigid-body": (3, set()),
}  # fmt: skip


def test_there_are_these():
    assert sorted(p.stem for p in FOLDER.iterdir()) == sorted(TEMPLATES)


@pytest.mark.parametrize("template", TEMPLATES)
def test_a_template_runs(lagsim, tmp_path, template):
    called = lagsim("new", "mine", "--template", template, code=0, err="")
    assert "mine.yaml" in called.out
    text = (tmp_path / "mine.yaml").read_text(encoding="utf-8")
    assert text == (FOLDER / f"{template}.yaml").read_text(encoding="utf-8")
    assert text.count("#") >= 4, "it explains itself"
    checked = lagsim("check", "mine.yaml", "--json").json
    assert checked["admissible"]
    assert checked["warnings"] == []
    kinds = {c["kind"] for c in checked["constraints"]}
    assert (checked["degrees_of_freedom"], kinds) == STRUCTURE[template]
    ran = lagsim("run", "mine.yaml", "--no-plots", "--json", code=0)
    assert (ran.json["complete"], ran.json["warnings"]) == (True, [])
    # Energies of 0.1 to 25 J, kept to 1e-11 in each of a few hundred steps.
    assert ran.json["energy_drift"] < 1e-8


def test_the_default_is_the_pendulum(lagsim, tmp_path):
    assert lagsim("new", "swing.yaml").code == 0
    assert (tmp_path / "swing.yaml").read_bytes() == (
        FOLDER / "pendulum.yaml"
    ).read_bytes()


def test_nothing_is_overwritten(lagsim, tmp_path):
    (tmp_path / "mine.yaml").write_text("years of work")
    called = lagsim("new", "mine", code=2, out="")
    assert called.reports("E703", "mine.yaml")
    assert (tmp_path / "mine.yaml").read_text() == "years of work"


def test_the_wheel_has_what_is_no_code():
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    package = ROOT / "lagsim"
    globs = declared["tool"]["setuptools"]["package-data"]["lagsim"]
    packed = {path for pattern in globs for path in package.glob(pattern)}
    there = {
        path
        for path in package.rglob("*")
        if path.is_file() and path.suffix not in (".py", ".pyc")
    }
    assert there == packed
