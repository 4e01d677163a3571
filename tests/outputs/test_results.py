"""The folder of results: replaced as a whole, or left as it was."""

import json
import os
import sys
import threading
from functools import partial
from pathlib import Path

import pytest

from lagsim.outputs import results as module
from lagsim.outputs.results import open_results
from tests.support import refused


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def put(folder, **files):
    """Write files, and a run.json that lists the files."""
    with open_results(folder) as results:
        for name, content in files.items():
            results.write(name, content)
        listed = [*results.names, "run.json"]
        results.commit(json.dumps({"files": listed}).encode())


needs_links = pytest.mark.skipif(
    sys.platform == "win32", reason="no links without rights"
)


def full(*_):
    raise OSError(28, "No space left on device")


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "a" / "b"


def test_nothing_appears_before_the_commit_and_nothing_without_one(folder):
    with open_results(folder) as results:
        results.write("a", b"1")
    assert names(folder) == []
    with open_results(folder) as results:
        results.write("a", b"1")
        results.part("b").write_bytes(b"2")
        assert [name for name in names(folder) if not name.startswith(".")] == []
        results.commit(b"{}")
        assert [n for n in names(folder) if n[0] != "."] == ["a", "b", "run.json"]
    assert names(folder) == ["a", "b", "run.json"]
    found = [(folder / name).read_bytes() for name in names(folder)]
    assert found == [b"1", b"2", b"{}"]


def test_of_what_the_last_run_listed_only_files_of_lagsim_go(folder):
    put(folder, **{"energy.png": b"1", "events.csv": b"1"})
    mine = ["thesis.tex", "energy.py", "plot_1.png.bak", "my_events.csv", ".bashrc"]
    for name in mine:
        (folder / name).write_text("mine")
    listed = [*mine, "energy.png", "events.csv"]
    (folder / "run.json").write_text(json.dumps({"files": listed}))
    put(folder, **{"events.csv": b"2", "plot_1.png": b"2"})
    assert names(folder) == sorted([*mine, "events.csv", "plot_1.png", "run.json"])
    assert (folder / "events.csv").read_bytes() == b"2"


@needs_links
@pytest.mark.parametrize(
    "name", [".lagsim-run.json.part", ".lagsim-energy.png.part", module.LOCK]
)
@pytest.mark.parametrize("there", [True, False])
def test_nothing_is_written_through_a_planted_link(folder, name, there):
    folder.mkdir(parents=True)
    outside = folder.parent / "outside"
    if there:
        outside.write_text("mine")
    (folder / name).symlink_to(outside)
    put(folder, **{"energy.png": b"1"})
    assert outside.exists() is there
    assert not there or outside.read_text() == "mine"


@needs_links
def test_a_link_in_the_place_of_a_result_is_replaced(folder):
    folder.mkdir(parents=True)
    outside = folder.parent / "outside"
    outside.write_text("mine")
    for name in ("run.json", "energy.png", "a.xml"):
        (folder / name).symlink_to(outside)
    put(folder, **{"energy.png": b"1"})
    module.write_atomically(folder / "a.xml", b"1")
    assert outside.read_text() == "mine"
    assert not any(path.is_symlink() for path in folder.iterdir())


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes that have names")
@pytest.mark.parametrize(
    "name", ["run.json", ".lagsim-run.json.part", "energy.png", module.LOCK]
)
def test_no_pipe_is_waited_for(folder, name):
    folder.mkdir(parents=True)
    os.mkfifo(folder / name)
    put(folder, **{"energy.png": b"1"})
    assert names(folder) == ["energy.png", "run.json"]
    assert (folder / "energy.png").read_bytes() == b"1"


@pytest.mark.parametrize("call", ["write", "fsync", "replace"])
def test_one_file_is_put_whole_or_not_at_all(tmp_path, monkeypatch, call):
    module.write_atomically(tmp_path / "a.xml", b"1")
    monkeypatch.setattr(os, call, full)
    with pytest.raises(OSError, match="No space"):
        module.write_atomically(tmp_path / "a.xml", b"2")
    assert names(tmp_path) == ["a.xml"]
    assert (tmp_path / "a.xml").read_bytes() == b"1"


LISTED = [
    ["../outside"], ["sub/file"], ["/tmp/none"], ["."], [".."], [""], ["a\0b"],
    ["../energy.png"], ["sub/energy.png"], ["energy.png\n"], {},
    [1, None, {}], ["kept", "run.json", "sub"], {"kept": 1}, "kept", None,
]  # fmt: skip
GARBLED = [b"", b"[]", b"{", b"\xff"]


@pytest.mark.parametrize(
    "content", [*(json.dumps({"files": x}).encode() for x in LISTED), *GARBLED]
)
def test_a_manifest_that_somebody_has_altered(folder, content):
    (folder / "sub").mkdir(parents=True)
    strangers = [
        folder.parent / "outside", folder / "sub" / "file",
        folder.parent / "energy.png", folder / "sub" / "energy.png",
    ]  # fmt: skip
    for path in strangers:
        path.write_text("mine")
    (folder / "run.json").write_bytes(content)
    put(folder, kept=b"1")
    assert all(path.read_text() == "mine" for path in strangers)
    assert names(folder) == ["kept", "run.json", "sub"]


def test_a_folder_is_held_by_one_run(folder):
    with open_results(folder) as first:
        first.write("a", b"first")
        with refused("output-folder", str(folder)), open_results(folder):
            pass
        first.commit(b"{}")
    put(folder, a=b"second")
    assert (folder / "a").read_bytes() == b"second"


@pytest.mark.skipif(sys.platform == "win32", reason="no such locks")
def test_a_run_elsewhere_holds_the_file_that_is_locked(folder):
    """As on a network's file system, where a lock of the folder is this machine's."""
    import fcntl

    folder.mkdir(parents=True)
    with (folder / module.LOCK).open("w") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        with refused("output-folder", str(folder)), open_results(folder):
            pass
        assert names(folder) == [module.LOCK]
        threading.Timer(0.1, (folder / module.LOCK).unlink).start()  # as its end does
        threading.Timer(0.2, other.close).start()
        with open_results(folder, patience=60.0) as results:
            assert (folder / module.LOCK).exists()
            results.commit(b"{}")
    assert names(folder) == ["run.json"]


def test_what_a_killed_run_has_begun_goes_with_the_next(folder):
    put(folder, a=b"1")
    (folder / module.LOCK).touch()
    (folder / ".lagsim-a.part").write_bytes(b"half")
    (folder / ".lagsim-old.part").write_bytes(b"half")
    (folder / ".other.part").touch()
    put(folder, a=b"2")
    assert names(folder) == [".other.part", "a", "run.json"]


def test_room_is_kept_for_the_manifest(folder):
    with open_results(folder) as results:
        part = folder / ".lagsim-run.json.part"
        assert part.stat().st_size == module.RESERVE_BYTES
        inode = part.stat().st_ino
        results.commit(b"{}")
        assert (folder / "run.json").stat().st_ino == inode
    assert (folder / "run.json").read_bytes() == b"{}"


@pytest.mark.parametrize("call", ["write", "fsync"])
def test_what_cannot_be_written_leaves_the_old_results(folder, monkeypatch, call):
    put(folder, a=b"1")
    with open_results(folder) as results:
        results.write("a", b"2")
        monkeypatch.setattr(os, call, full)
        if call == "write":
            with pytest.raises(OSError, match="No space"):
                results.write("b", b"2")
        with pytest.raises(OSError, match="No space"):
            results.commit(b"{}")
        assert results.names == ["a"]
    assert names(folder) == ["a", "run.json"]
    assert (folder / "a").read_bytes() == b"1"
    assert json.loads((folder / "run.json").read_bytes())["files"] == ["a", "run.json"]


def test_a_commit_is_whole_at_any_point(folder, monkeypatch):
    """A process killed at any point leaves a complete result."""
    kept, texts = ("energy.png", "events.csv"), {False: b"old", True: b"new"}
    put(folder, **dict.fromkeys((*kept, "plot_1.png"), b"old"))
    seen = []

    def look():
        found = [(folder / name).read_bytes() for name in kept]
        assert {*found} <= {*texts.values()}
        if (folder / "run.json").exists():  # it describes what is there
            document = json.loads((folder / "run.json").read_bytes())
            assert {*found} == {texts[document.get("new", False)]}
            assert {*document["files"]} <= {*names(folder)}
        seen.append(found)

    def watched(call, *arguments, **options):
        look()
        return call(*arguments, **options)

    with open_results(folder) as results:
        for name in kept:
            results.write(name, b"new")
        for name in ("open", "write", "fsync", "replace", "unlink"):
            monkeypatch.setattr(os, name, partial(watched, getattr(os, name)))
        results.commit(b'{"files": ["energy.png", "events.csv"], "new": true}')
        monkeypatch.undo()
    look()
    assert [seen[0], seen[-1]] == [[b"old"] * 2, [b"new"] * 2]
    assert len(seen) > 12
    assert names(folder) == [*kept, "run.json"]


# --- Another result is not replaced without a word

MODEL = {"name": "a", "file": "a.yaml", "sha256": "1"}
NOW = {
    "model": MODEL, "parameters": {"l": 1.0, "g": 9.8, "m": 1.0, "k": 2.0, "new": 1.0},
    "method": "taylor", "formulation": "none", "rtol": 1e-11, "atol": None,
    "step": None, "outcome": "done", "end": 10.0,
}  # fmt: skip


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
        ({"model": {}}, "of None in results/a"),
        ({}, None),
        (of_model(sha256="2") | {"parameters": {"l": 2.0}}, None),  # it was edited
        (of_model(file="./a.yaml", sha256="2"), None),
        (of_model(file="copy.yaml"), None),
        ({"outcome": "interrupted", "end": 5.0}, None),
        ({"parameters": {"gone": 2.0}}, None),
        ({"model": None, "parameters": []}, None),
    ],
)
def test_what_is_told_of_a_result_that_is_replaced(before, told):
    caution = module.replaced({**NOW, **before}, NOW, Path("results/a"))
    if told is None:
        assert caution is None
    else:
        assert caution.code == "result-replaced"
        assert told in caution.text
        assert "-o DIR" in caution.text
