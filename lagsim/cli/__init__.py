"""The commands, one file each; the only place that prints or exits."""

from __future__ import annotations

import contextlib
import errno
import gc
import io
import os
import signal
import sys
import threading
from importlib import import_module
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from collections.abc import Iterator

    import typer

COMMANDS = (
    "new", "run", "sweep", "check", "derive", "compare", "overlay", "spectrum",
    "golden", "bench", "stability", "methods", "schema",
)  # fmt: skip

_INTERRUPTED = 128 + signal.SIGINT
_TERMINATED = 128 + signal.SIGTERM


class _Terminated(BaseException):
    """SIGTERM, raised where it arrives so that what was begun is removed."""


def main() -> int:
    """Run the command line; give the exit code."""
    from lagsim.cli import _streams

    _streams.prepare()
    try:
        with _terminable():
            return _guarded(_application())
    except _Terminated:
        return _TERMINATED
    except KeyboardInterrupt:
        return _INTERRUPTED


def entry() -> int:
    """Run the command line as a process of its own; give the exit code."""
    # Loading and deriving make many objects and no garbage; looking through them again
    # and again takes longer than integrating. What is left goes with the process.
    gc.disable()
    # A thread for each core takes longer to begin than what the small matrices here
    # take; numpy's OpenBLAS looks when it is loaded.
    if "OMP_NUM_THREADS" not in os.environ:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    code = main()
    gc.freeze()
    return code


def _application() -> typer.Typer:
    import typer

    from lagsim.cli._shared import ask_version

    # Only the command that is called is loaded; all of them where none is, for help and
    # for the shell that completes a line.
    called = [name for name in COMMANDS if name in sys.argv[1:2]]
    app = typer.Typer(
        name="lagsim",
        no_args_is_help=True,
        add_completion=not called,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(ask_version)
    for name in called or COMMANDS:
        command = import_module(f"lagsim.cli.{name}").command
        # Said, it is wrapped; what is taken from the long help is cut to a line.
        summary = (command.__doc__ or "").partition("\n")[0]
        app.command(name, short_help=summary)(command)
    return app


def _guarded(app: typer.Typer) -> int:
    """Call the application; anything unforeseen is a bug, exit 70."""
    import typer

    from lagsim.cli import _streams

    try:
        code = app(prog_name="lagsim", standalone_mode=False)
        _streams.put(lambda: None)
    except typer.Exit as wish:
        return int(wish.exit_code)
    except SystemExit as done:  # a shell has asked how a line goes on
        return int(done.code or 0)
    except typer.Abort:
        return _INTERRUPTED
    except Exception as error:  # noqa: BLE001  the last resort of a command line
        if callable(getattr(error, "show", None)):  # a usage error
            return _usage(error)
        if isinstance(error, OSError) and error.errno == errno.ENOSPC:
            return _streams.full(error)  # help, on a disk without room for it
        from lagsim.cli._faults import bug

        return bug()
    return code if isinstance(code, int) else 0


def _usage(error: Exception) -> int:
    """Tell what is wrong with the command line."""
    from lagsim.cli import _streams
    from lagsim.cli._faults import errors_document
    from lagsim.cli._shared import show_json
    from lagsim.errors import Problem

    if "--json" in sys.argv[1:]:
        told = getattr(error, "format_message", lambda: str(error))()
        show_json(errors_document([Problem("usage", told)]))
    else:
        with contextlib.redirect_stderr(io.StringIO()) as told:
            error.show()  # type: ignore[attr-defined]
        _streams.complain(told.getvalue().rstrip("\n"))
    return 2


@contextlib.contextmanager
def _terminable() -> Iterator[None]:
    """Turn SIGTERM into an exception (in the main thread, where it is not ignored)."""
    from lagsim.run.interrupt import ignored

    def stop(_number: int, _frame: object) -> NoReturn:
        raise _Terminated

    main = threading.current_thread() is threading.main_thread()
    if not main or ignored(signal.SIGTERM):
        yield
        return
    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
