"""Another result is not replaced without a word."""

from __future__ import annotations

from pathlib import Path

import pytest

from lagsim.outputs.results import replaced

NOW = {
    "model": {"name": "a", "file": "a.yaml", "sha256": "1"},
    "parameters": {"l": 1.0, "g": 9.8, "m": 1.0, "k": 2.0, "new": 1.0},
    "method": "taylor", "formulation": "none", "rtol": 1e-11, "atol": None,
    "step": None, "outcome": "done", "end": 10.0,
}  # fmt: skip
MODEL = NOW["model"]


def of_model(**other):
    return {"model": {**MODEL, **other}}


@pytest.mark.parametrize(
    ("before", "told"),
    [
        ({"parameters": {"l": 2.0, "g": 9.8}}, "with l = 2.0 in results/a"),
        (
            {"parameters": {"l": 2.0, "g": 1.0, "m": 3.0, "k": 4.0}},
            "with l = 2.0, g = 1.0, m = 3.0 and 1 more in results/a",
        ),
        ({"method": "radau", "rtol": 1e-6}, "with method radau, rtol 1e-06 in"),
        ({"end": 5.0}, "with end 5.0 in"),
        (of_model(file="b.yaml", sha256="2"), "of b.yaml in results/a"),
    ],
)
def test_what_is_told(before, told):
    caution = replaced({**NOW, **before}, NOW, Path("results/a"))
    assert caution is not None
    assert caution.code == "result-replaced"
    assert told in caution.text
    assert "-o DIR" in caution.text


@pytest.mark.parametrize(
    "before",
    [
        {},
        of_model(sha256="2") | {"parameters": {"l": 2.0}},  # the file was edited
        of_model(file="./a.yaml", sha256="2"),
        of_model(file="copy.yaml"),
        {"outcome": "interrupted", "end": 5.0},
        {"parameters": {"gone": 2.0}},
        {"model": None, "parameters": []},
    ],
)
def test_nothing_to_tell(before):
    assert replaced({**NOW, **before}, NOW, Path("results/a")) is None


def test_records_that_are_none():
    assert replaced({"model": {}}, NOW, Path("r")) is not None
    assert replaced({"files": 3}, NOW, Path("r")) is None
