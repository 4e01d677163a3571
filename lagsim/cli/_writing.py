"""Results while they are written, and what is reported where the disk is full."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any

from lagsim.cli._streams import UnwritableError, complain

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from lagsim.outputs.results import Results


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Report what keeps a file from being written, or files into a folder.

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
    """Write a picture; return whether it could be drawn.

    Raises
    ------
    UnwritableError
        Where it cannot be written.
    """
    content = drawn(path.name, draw, [])
    if content is not None:
        put_file(path, content, folders=folders)
    return content is not None


def drawn(name: str, draw: Callable[[], bytes], warnings: list[Any]) -> bytes | None:
    """Return a picture; where it cannot be drawn, report why, here and in a list."""
    from lagsim.outputs import attempted

    content = attempted(name, draw)
    if isinstance(content, bytes):
        return content
    complain(f"warning: {content.text} [{content.number}]")
    warnings.append(content.record)
    return None


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
