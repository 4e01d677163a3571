"""Results while they are written, and what is reported where the disk is full."""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING, Any, cast

from lagsim.cli._streams import UnwritableError, complain

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from pathlib import Path

    from lagsim.outputs import Format
    from lagsim.outputs.attempted import Made
    from lagsim.outputs.results import Results
    from lagsim.outputs.table import TableWriter, Writer
    from lagsim.run.apart import Apart
    from lagsim.run.arcs import Run
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.observers import Relay
    from lagsim.run.session import Clock, Session
    from lagsim.studies.attempts import Attempt
    from lagsim.studies.restart import Restart

# What a run has come to is kept from then on, for `--resume`; shorter ones begin again.
KEPT_AFTER_SECONDS = 3.0
# Numbers in a table from which on it is asked whether the disk has room: 20 megabytes.
MANY = 1_000_000


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


def open_table(
    results: Results, form: Format, units: Mapping[str, str], *, show_units: bool
) -> contextlib.closing[Writer]:
    """Open the table for its rows."""
    from lagsim.outputs.table import table_writer

    try:
        path = results.part(form.file)
        return contextlib.closing(
            table_writer(form, path, units, show_units=show_units)
        )
    except OSError as error:
        raise results.unusable(error) from None


def ask_for_room(session: Session, folder: Path, form: Format, *, quiet: bool) -> None:
    """Refuse a table that fills the disk, before it is computed.

    Raises
    ------
    InputError
    """
    settings, columns = session.case.settings, session.system.columns.table
    if settings.duration / settings.output_step * columns < MANY:
        return
    from lagsim.outputs.results import refuse_without_room

    ends = session.case.equations.model.until is not None
    told = refuse_without_room(folder, form, settings, columns, ends=ends)
    if told and not quiet:
        complain(f"warning: {told}")


class Later:
    """Has a run kept from some seconds on; before, nothing for that is loaded."""

    def __init__(self, writer: Writer, made: Callable[[], Restart]) -> None:
        self.writer, self.made = writer, made

    def __call__(
        self, run: Run | Apart, *, relay: Relay, session: Session, at_once: bool = False
    ) -> None:
        """Take a run that is about to begin; or put it where another was."""
        due = time.monotonic() + KEPT_AFTER_SECONDS

        def tick(run: Run | Apart) -> None:
            if at_once or time.monotonic() > due:
                from lagsim.studies.restart import Kept

                writer = cast("TableWriter", self.writer)
                self.made().join(run, Kept(session, relay, writer))

        if at_once:
            tick(run)
        else:
            run.tick = tick


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


def tell_of_replaced(results: Results, document: dict[str, Any]) -> None:
    """Add the warning that the folder held a result of something else."""
    before = results.before()
    if not before:
        return
    from lagsim.outputs.results import replaced

    caution = replaced(before, document, results.folder)
    document["warnings"] += [caution.record] if caution else []


def filled(results: Results, made: Iterable[Made]) -> OSError | None:
    """Write files of numbers; give what kept one from being written."""
    try:
        list(results.fill(made))
    except OSError as error:
        return error
    return None


def draw_all(
    results: Results,
    document: dict[str, Any],
    more: Iterable[Made],
    interrupt: Interrupt,
    clock: Clock,
) -> OSError | None:
    """Add page and pictures; give what kept one from being written.

    The table and the record are in their places before: whatever becomes of pictures,
    rows are there. A signal ends the drawing: pictures can be drawn again.
    """
    from lagsim.outputs.manifest import encode
    from lagsim.outputs.results import MANIFEST

    # Where there is no room for that, pictures will say so.
    with contextlib.suppress(OSError):
        results.stand(encode(document | {"sha256": results.digests()}))

    def draw() -> None:
        for caution in results.fill(more):
            document["warnings"].append(caution.record)

    try:
        interrupt.cut(draw)
    except OSError as error:
        return error
    finally:
        clock.lap("plots")
        document["timings"] = clock.rounded()
        document["files"] = [*results.names, MANIFEST]
    return None


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


def finish(writer: Writer, results: Results, form: Format) -> OSError | None:
    """Make the table whole; give what kept it from that, and then there is none."""
    try:
        writer.finish()
    except OSError as error:
        results.drop(form.file)
        return error
    return None


def cut_short(
    writer: Writer, made: Attempt, full: OSError, *, lost: bool
) -> dict[str, Any]:
    """Give what run.json says of a run whose results did not fit on the disk.

    `lost`: not even the table did.
    """
    from lagsim.codes import failure

    found: dict[str, Any] = {"outcome": "failed", "complete": False}
    found["failure"] = failure(UnwritableError.code)
    if lost:
        found["reason"] = (
            f"the table could not be written: {full.strerror}; a CSV table is "
            "written row by row, and would keep its rows"
        )
        return found
    if made.fault is None:
        found["reason"] = (
            "events or a picture could not be written: "
            f"{full.strerror}; the table is whole"
        )
        return found
    end = made.trajectory.start if writer.last is None else writer.last
    found["reason"] = (
        f"the table could not be written beyond t = {end!r}: {full.strerror}; the rows "
        "up to there were kept"
    )
    return found | {"end": end, "rows": writer.rows}
