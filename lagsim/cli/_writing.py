"""Results while they are written, and what is reported where the disk is full."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any

from lagsim.cli._streams import UnwritableError, complain

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from pathlib import Path

    from lagsim.outputs.attempted import Made
    from lagsim.outputs.results import Results


def put_file(path: Path, content: bytes, *, folders: bool = False) -> None:
    """Write a file as a whole, and, if asked to, the folders that it needs.

    Raises
    ------
    UnwritableError
        Where that fails.
    """
    from lagsim.outputs.results import put

    with writing(path):
        if folders:
            path.parent.mkdir(parents=True, exist_ok=True)
        put(path, content)


def put_picture(
    path: Path, draw: Callable[[], bytes], *, folders: bool = False
) -> bool:
    """Write a picture beside a verdict; tell whether it could be drawn.

    Raises
    ------
    UnwritableError
        Where it cannot be written.
    """
    from lagsim.outputs.attempted import attempted

    drawn, _ = sorted_out([(path.name, attempted(path.name, draw))])
    for content in drawn.values():
        put_file(path, content, folders=folders)
    return bool(drawn)


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Tell what keeps a file from being written, or files into a folder.

    Raises
    ------
    UnwritableError
    """
    try:
        yield
    except OSError as error:
        where = path if path.parent.is_dir() else path.parent
        text = f"lagsim: {where} cannot be written: {error.strerror}"
        raise UnwritableError(text) from None


def commit(results: Results, document: Any, files: Mapping[str, bytes]) -> None:
    """Write files and the document that lists them, and put all in their places.

    Raises
    ------
    UnwritableError
        Where there is no room.
    """
    from lagsim.outputs.manifest import encode

    with writing(results.folder):
        for name, content in files.items():
            results.write(name, content)
        results.commit(encode(document))


def sorted_out(made: Iterable[Made]) -> tuple[dict[str, bytes], dict[str, Any]]:
    """Say what could not be drawn; give the files that are, and what documents say."""
    files, warnings = {}, []
    for name, content in made:
        if isinstance(content, bytes):
            files[name] = content
        else:
            complain(f"warning: {content.text} [{content.number}]")
            warnings.append(content.record)
    return files, {"warnings": warnings} if warnings else {}
