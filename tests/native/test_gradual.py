"""Kernels are linked as quick code first, and optimised as they are used."""

from __future__ import annotations

import ctypes
import time
from typing import TYPE_CHECKING

import numpy as np
import pytest

from lagsim.model.reader import read_file
from lagsim.native.link import ahead, cache, gradual
from lagsim.native.link.engine import Engine
from lagsim.native.link.gradual import GradualParts
from lagsim.run.observers import Keep
from lagsim.run.session import open_case
from tests.support import MODELS

if TYPE_CHECKING:
    from pathlib import Path

    from lagsim.language.arrays import Floats

IR = "define double @constant() {\n  ret double 4.5\n}\n"


def scaled(n: int, y: Floats) -> None:
    for i in range(n):
        y[i] = y[i] * y[i] / 3.0 - y[i]


def shifted(n: int, y: Floats) -> None:
    for i in range(n):
        y[i] += 0.1 * i


@pytest.fixture
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of the objects of an empty cache."""
    monkeypatch.setenv("LAGSIM_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "objects"


def program() -> list[cache.ProgramPart]:
    written = cache.graph_part(IR, lambda: (IR, 7))
    return [written, cache.kernel_part([scaled]), cache.kernel_part([shifted])]


def values(parts: GradualParts) -> list[float]:
    engine = Engine(parts.objects)
    y = np.linspace(-1.0, 2.0, 50)
    kinds = [ctypes.c_int64, ctypes.c_void_p]
    for name in ("scaled", "shifted"):
        engine.function(name, None, kinds)(len(y), y.ctypes.data)
    return [engine.function("constant", ctypes.c_double, [])(), *y.tolist()]


@pytest.mark.usefixtures("empty")
def test_kernels_that_run_longer_are_optimised() -> None:
    parts = GradualParts(program(), quick=True)
    first = parts.objects
    assert not parts.used(gradual.SHORT / 2.0)
    found = values(parts)
    assert len(parts.improvable) == 3
    assert parts.used(gradual.SHORT)
    assert len(parts.improvable) == 1  # functions of the model, after the kernels
    assert values(parts) == found
    assert parts.used(gradual.SHORT)
    assert values(parts) == found
    assert parts.improvable == []
    assert not parts.used(1e9)
    differs = [a != b for a, b in zip(first, parts.objects, strict=True)]
    assert differs[1:] == [True, True]
    assert all(part.is_compiled for part in program())


@pytest.mark.slow
@pytest.mark.usefixtures("empty")
@pytest.mark.skipif(not ahead.is_possible(), reason="no second process")
def test_new_functions_are_optimised_beside_the_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    in_this_process = []
    compiled = cache.ProgramPart._compiled

    def noted(part: cache.ProgramPart) -> bytes:
        in_this_process.append(part)
        return compiled(part)

    with ahead.second_processes():
        parts = GradualParts(program(), quick=True)
        found = values(parts)
        assert parts.used(gradual.SHORT)
        assert values(parts) == found
        monkeypatch.setattr(cache.ProgramPart, "_compiled", noted)
        assert not parts.used(gradual.SHORT)
        while not parts.used(gradual.SHORT):
            time.sleep(1e-3)
        assert parts.improvable == []
        assert values(parts) == found
    assert in_this_process == []
    assert all(part.is_compiled for part in program())


@pytest.mark.slow
@pytest.mark.usefixtures("empty")
def test_kernels_of_an_earlier_run_are_optimised_at_once() -> None:
    found = values(GradualParts(program(), quick=True))
    with ahead.second_processes():
        parts = GradualParts(program(), quick=True)
        assert values(parts) == found
        assert parts.used(gradual.SHORT)
        assert values(parts) == found


@pytest.mark.slow
@pytest.mark.usefixtures("empty")
@pytest.mark.skipif(not ahead.is_possible(), reason="no second process")
def test_kernels_of_an_earlier_run_are_optimised_before_new_functions() -> None:
    kernels = program()[1:]
    assert len(GradualParts(kernels, quick=True).objects) == 2
    with ahead.second_processes():
        parts = GradualParts(program(), quick=True)
        found = values(parts)
        assert parts.used(gradual.SHORT)
        assert len(parts.improvable) == 1
        assert values(parts) == found
        while not parts.used(gradual.SHORT):
            time.sleep(1e-3)
        assert parts.improvable == []
        assert values(parts) == found


@pytest.mark.usefixtures("empty")
def test_quick_code_of_an_earlier_process_is_used_again() -> None:
    before = GradualParts(program(), quick=True)
    found = values(before)
    again = GradualParts(program(), quick=True)
    assert len(again.improvable) == 3
    assert again.objects == before.objects
    assert values(again) == found


@pytest.mark.usefixtures("empty")
def test_quick_code_is_stored_with_the_length_of_p() -> None:
    assert [part.p_size for part in program()] == [7, 0, 0]  # written, not compiled
    assert len(GradualParts(program(), quick=True).objects) == 3

    def not_written() -> tuple[str, int]:
        raise AssertionError

    part = cache.graph_part(IR, not_written)
    assert part.p_size == 7
    assert not part.is_compiled


def test_optimised_code_is_used_where_it_is_stored(empty: Path) -> None:
    usual = GradualParts(program(), quick=False)
    assert usual.improvable == []
    assert values(usual) == values(GradualParts(program(), quick=True))
    assert len(list(empty.iterdir())) == 3


@pytest.mark.slow
@pytest.mark.usefixtures("empty")
@pytest.mark.parametrize("name", ["hopper", "newtons-cradle"])
def test_rows_are_those_of_optimised_code(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    case, tables, counts = open_case(read_file(str(MODELS / f"{name}.yaml"))), [], []
    for seconds in (1e9, 0.0):  # quick code throughout; optimised within the run
        monkeypatch.setattr(gradual, "SHORT", seconds)
        session, keep = case.ready(quick=True), Keep()
        parts = session.system.link(session.plan.method).parts
        counts.append(len(parts.improvable))
        session.run([keep])
        counts.append(len(parts.improvable))
        tables.append(keep.table)
    assert counts[0] == counts[1] == counts[2] > counts[3]
    keep = Keep()
    case.ready().run([keep])
    for table in tables:
        assert np.array_equal(table, keep.table)
