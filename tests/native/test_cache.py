"""Object code is kept, checked, and done without where it cannot be kept."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from lagsim.native.kernels import translation
from lagsim.native.kernels.keys import KernelError
from lagsim.native.kernels.words import unrolled
from lagsim.native.link import cache, engine

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.arrays import Floats

IR = "define double @f() {\n  ret double 4.5\n}\n"
FACTOR = 2.0


def doubled(n: int, y: Floats) -> None:
    for i in range(n):
        y[i] *= FACTOR


def wrong() -> None:
    for i in unrolled(2):
        i += 1  # noqa: PLW2901


def made(ir: str) -> bytes:
    """Return an object from the cache, or compile it; its IR is unique."""
    part = cache.graph_part(ir, lambda: (ir, 7))
    assert part.p_size == 7
    return part.object


def value(code: bytes) -> float:
    result = engine.Engine([code]).function("f", ctypes.c_double, [])()
    assert isinstance(result, float)
    return result


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of the objects."""
    monkeypatch.setenv("LAGSIM_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "objects"


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return a list to which the IR of each compilation is appended."""
    seen: list[str] = []
    original = engine.compile_object

    def count(ir: str, *, optimise: bool = True, quick: bool = False) -> bytes:
        seen.append(ir)
        return original(ir, optimise=optimise, quick=quick)

    monkeypatch.setattr(engine, "compile_object", count)
    return seen


def test_compiled_once(kept: Path, compiled: list[str]) -> None:
    first = made(IR)
    assert made(IR) == first
    assert compiled == [IR]
    assert value(first) == 4.5
    assert len(list(kept.iterdir())) == 1
    made(IR.replace("4.5", "5.5"))
    assert len(compiled) == 2


def test_kernels_are_translated_once(
    kept: Path, compiled: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    first, ir = cache.kernel_part([doubled]).object, cache.kernel_part([doubled]).ir
    monkeypatch.setattr(translation, "translate", None)
    assert cache.kernel_part([doubled]).object == first
    monkeypatch.setenv("LAGSIM_CPU", "generic")  # IR is that of all targets
    assert cache.kernel_part([doubled]).ir == ir
    monkeypatch.undo()
    assert len(compiled) == 1
    monkeypatch.setenv("LAGSIM_CACHE", str(kept.parent))
    array = (ctypes.c_double * 2)(1.0, 2.0)
    for statics in (None, {"FACTOR": 3.0}):
        code = cache.kernel_part([doubled], statics).object
        pointer = ctypes.POINTER(ctypes.c_double)
        run = engine.Engine([code]).function("doubled", None, [ctypes.c_int64, pointer])
        run(2, array)
    assert list(array) == [6.0, 12.0]
    assert len(list(kept.iterdir())) == 3


@pytest.mark.usefixtures("kept")
def test_faults_of_kernels_come_out() -> None:
    with pytest.raises(KernelError):
        _ = cache.kernel_part([wrong]).object


def test_another_cpu_is_another_object(
    kept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for cpu in ("host", "generic", "host"):
        monkeypatch.setenv("LAGSIM_CPU", cpu)
        assert value(made(IR)) == 4.5
    assert len(list(kept.iterdir())) == 2


@pytest.mark.parametrize("where", [0, 20, 60, -1])
@pytest.mark.parametrize("how", ["cut", "changed", "empty"])
def test_damaged_files_are_made_anew(
    kept: Path, compiled: list[str], where: int, how: str
) -> None:
    good = made(IR)
    [path] = kept.iterdir()
    content = path.read_bytes()
    damaged = bytearray(content)
    damaged[where] ^= 4
    path.write_bytes({"cut": content[:where], "changed": damaged, "empty": b""}[how])
    assert made(IR) == good
    assert len(compiled) == 2
    assert path.read_bytes() == content


def writable_by_others(kept: Path) -> None:
    kept.chmod(0o770)


def of_another(kept: Path) -> None:
    os.chown(kept, kept.stat().st_uid + 1, -1)


def a_link(kept: Path) -> None:
    kept.rename(kept.with_name("elsewhere"))
    kept.symlink_to(kept.with_name("elsewhere"))


def a_file(kept: Path) -> None:
    for path in kept.iterdir():
        path.unlink()
    kept.rmdir()
    kept.write_text("in the way")


@pytest.mark.skipif(sys.platform == "win32", reason="modes, owners, links of POSIX")
@pytest.mark.parametrize("spoil", [writable_by_others, of_another, a_link, a_file])
def test_a_folder_that_is_not_this_users_alone_is_not_used(
    kept: Path, compiled: list[str], spoil: Callable[[Path], None]
) -> None:
    made(IR)
    assert kept.stat().st_mode & 0o777 == 0o700
    [path] = kept.iterdir()
    assert path.stat().st_mode & 0o777 == 0o600
    if spoil is of_another and os.getuid() != 0:
        pytest.skip("only root gives files away")
    # What others may write to is not run, and nothing is put there.
    spoil(kept)
    assert cache.folder() is None
    assert value(made(IR)) == 4.5
    assert len(compiled) == 2


def test_no_room(
    kept: Path, compiled: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", refuse)
    assert value(made(IR)) == 4.5
    assert list(kept.iterdir()) == []
    monkeypatch.setattr("tempfile.mkstemp", refuse)
    assert value(made(IR)) == 4.5
    assert len(compiled) == 2


@pytest.mark.parametrize(
    ("platform", "variables", "expected"),
    [
        ("linux", {}, "home/.cache/lagsim/objects"),
        ("linux", {"XDG_CACHE_HOME": "xdg"}, "home/.cache/lagsim/objects"),
        ("linux", {"XDG_CACHE_HOME": "{}/xdg"}, "xdg/lagsim/objects"),
        ("linux", {"LAGSIM_CACHE": "{}/own"}, "own/objects"),
        ("darwin", {}, "home/Library/Caches/lagsim/objects"),
        ("win32", {"LOCALAPPDATA": "{}/local"}, "local/lagsim/cache/objects"),
        ("win32", {}, None),
        ("linux", None, None),
    ],
)
def test_places(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    platform: str,
    variables: dict[str, str] | None,
    expected: str | None,
) -> None:
    for name in ("LAGSIM_CACHE", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    for name, text in (variables or {}).items():
        monkeypatch.setenv(name, text.format(tmp_path))
    monkeypatch.setattr(sys, "platform", platform)

    def home() -> Path:
        if variables is None:
            raise RuntimeError("Could not determine home directory.")
        return tmp_path / "home"

    monkeypatch.setattr(Path, "home", home)
    assert cache.folder() == (None if expected is None else tmp_path / expected)


def test_the_oldest_go_first(tmp_path: Path) -> None:
    now = time.time()
    for age in range(8):
        path = tmp_path / f"{age}.object"
        path.write_bytes(b"x" * 100)
        os.utime(path, (now - age * 10, now - age * 10))
    (tmp_path / "being-written").write_bytes(b"x" * 1000)
    (tmp_path / "abandoned").write_bytes(b"x" * 100)
    os.utime(tmp_path / "abandoned", (now - 90000, now - 90000))
    cache.prune(tmp_path, limit=900)
    assert len(list(tmp_path.iterdir())) == 10
    cache.prune(tmp_path, limit=700)
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == ["0.object", "1.object", "2.object", "being-written"]


def test_use_renews(kept: Path) -> None:
    made(IR)
    [path] = kept.iterdir()
    os.utime(path, (1e9, 1e9))
    made(IR)
    assert path.stat().st_mtime > 1e9 + 1.0


@pytest.mark.usefixtures("kept")
def test_processes_at_once(kept: Path) -> None:
    code = (
        "import ctypes\n"
        "from lagsim.native.link import cache, engine\n"
        f"code = cache.graph_part('x', lambda: ({IR!r}, 0)).object\n"
        "f = engine.Engine([code]).function('f', ctypes.c_double, [])\n"
        "print(f())\n"
    )
    command = [sys.executable, "-c", code]
    running = [
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(4)
    ]
    assert [process.communicate()[0] for process in running] == ["4.5\n"] * 4
    assert [path.suffix for path in kept.iterdir()] == [".object"]
