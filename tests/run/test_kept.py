"""A session that was kept is the one that would be made."""

from __future__ import annotations

import pickle
import sys

import numpy as np
import pytest

from lagsim.errors import InputError
from lagsim.model.reader import read, read_file
from lagsim.outputs.units import of_table
from lagsim.run import kept
from lagsim.run.kept import Asked, kept_session
from lagsim.run.observers import Keep
from lagsim.run.session import open_case, wanted
from tests.support import MODELS

NAMES = sorted(path.stem for path in MODELS.glob("*.yaml"))
TEXT = """
coordinates: {x: {}}
parameters: {k: 4.0}
energy: {kinetic: x_dot^2/2, potential: k*x^2/2}
initial: {x: 1.0}
simulation: {duration: 1.0}
"""
ASKED = Asked(TEXT, "model.yaml", {}, {})


@pytest.fixture
def empty(tmp_path, monkeypatch):
    monkeypatch.setenv("LAGSIM_CACHE", str(tmp_path))
    # Other tests have loaded it.
    monkeypatch.delitem(sys.modules, kept.UNASKED, raising=False)


def made(asked):
    model = read(*asked)
    return open_case(model, wanted(model, "run")).ready()


class Counted:
    """Makes sessions, and counts them."""

    def __init__(self):
        self.calls = 0

    def __call__(self, asked=ASKED):
        def make():
            self.calls += 1
            return made(asked)

        return kept_session(asked, make)


def rows(session):
    keep = Keep()
    session.run([keep])
    return keep.table


@pytest.mark.parametrize("name", NAMES)
def test_a_kept_session_runs_as_the_one_that_was_made(name):
    model = read_file(str(MODELS / f"{name}.yaml"))
    settings = model.settings({"duration": "0.05"})
    session = open_case(model, settings).ready()
    again = pickle.loads(kept._bytes(session))
    assert np.array_equal(rows(again), rows(session), equal_nan=True)
    assert again.plan.choices == session.plan.choices
    columns = session.system.columns.of_table
    assert of_table(again.case.equations, columns) == of_table(
        session.case.equations, columns
    )


@pytest.mark.usefixtures("empty")
def test_what_was_asked_for_before_is_not_made_again():
    find = Counted()
    first, second = find(), find()
    assert find.calls == 1
    assert np.array_equal(rows(first), rows(second))


@pytest.mark.parametrize(
    "other",
    [
        {"text": TEXT.replace("4.0", "5.0")},
        {"text": TEXT + "\n"},
        {"file": "other.yaml"},
        {"overrides": {"k": "5"}},
        {"options": {"rtol": "1e-6"}},
    ],
)
@pytest.mark.usefixtures("empty")
def test_another_question_has_another_answer(other):
    find = Counted()
    find()
    asked = ASKED._replace(**other)
    assert np.array_equal(rows(find(asked)), rows(made(asked)))
    assert find.calls == 2


@pytest.mark.usefixtures("empty")
def test_other_code_makes_its_own(monkeypatch, tmp_path):
    find = Counted()
    find()
    (tmp_path / "room").mkdir()
    for text in ("a = 1", "a = 12"):
        (tmp_path / "room" / "file.py").write_text(text)
        monkeypatch.setattr(kept, "__file__", str(tmp_path / "room" / "kept.py"))
        kept._code.cache_clear()
        find()
    kept._code.cache_clear()
    assert find.calls == 3


@pytest.mark.usefixtures("empty")
def test_what_is_refused_is_refused_again():
    asked = ASKED._replace(text=TEXT.replace("initial", "intial"))
    for _ in range(2):
        with pytest.raises(InputError):
            Counted()(asked)


@pytest.mark.slow
@pytest.mark.usefixtures("empty")
def test_what_is_damaged_is_made_anew(tmp_path):
    find = Counted()
    usual = rows(find())
    for path in tmp_path.rglob("*.object"):
        path.write_bytes(path.read_bytes()[:-1] + b"?")
    assert np.array_equal(rows(find()), usual)
    assert find.calls == 2


@pytest.mark.usefixtures("empty")
def test_large_scenes_are_not_kept(monkeypatch):
    monkeypatch.setattr(kept, "MOST_NODES", 10)
    find = Counted()
    find()
    find()
    assert find.calls == 2


@pytest.mark.usefixtures("empty")
def test_it_binds_other_values_as_the_one_that_was_made():
    find = Counted()
    first, second = (find().case.equations.model.bind(k="2*3") for _ in range(2))
    assert find.calls == 1
    assert second.parameters == first.parameters
    assert second.parameters[0].value == 6.0
    assert second.settings() == first.settings()


@pytest.mark.slow
@pytest.mark.usefixtures("empty")
def test_what_is_nested_deep_runs_kept_or_not():
    deep = "(" * 90 + "k*x^2/2" + ")" * 90
    asked = ASKED._replace(text=TEXT.replace("k*x^2/2", deep))
    find = Counted()
    assert np.array_equal(rows(find(asked)), rows(find(asked)))
    assert np.array_equal(rows(find(asked)), rows(made(ASKED)))


@pytest.mark.usefixtures("empty")
def test_what_is_too_deep_to_be_kept_is_made_again(monkeypatch):
    def deeper(_):
        raise RecursionError

    monkeypatch.setattr(kept, "_bytes", deeper)
    find = Counted()
    find()
    find()
    assert find.calls == 2
