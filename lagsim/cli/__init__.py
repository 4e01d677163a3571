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
import time
import warnings
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any, NoReturn

from lagsim import files
from lagsim.codes.known import USAGE
from lagsim.errors import Problem
from lagsim.native.link.ahead import second_processes
from lagsim.run.interrupt import (
    AGAIN_SECONDS,
    ENDING,
    Terminated,
    exception_of,
    heard,
    ignored,
    noting,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import typer


COMMANDS = (
    "new", "explore", "run", "sweep", "check", "derive", "compare", "overlay",
    "spectrum", "golden", "bench", "stability", "equilibrium", "modes", "fit",
    "methods", "explain", "schema",
)  # fmt: skip
# Commands that compile with a second process: in others, threads or workers may be at
# work then, and a fork would copy their locks.
COMPILED_BY_TWO = ("run", "equilibrium", "modes", "fit")


def main() -> int:
    """Run the command line with the arguments of the process; return the exit code."""
    from lagsim.cli import _shared

    _shared.prepare()
    try:
        with signals_raised(), _helped():
            return _guarded(_application)
    except Terminated:
        return 128 + signal.SIGTERM
    except KeyboardInterrupt:
        return 128 + signal.SIGINT


def entry() -> int:
    """Run the command line as a process of its own; return the exit code."""
    for kind in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(kind) is not signal.SIG_IGN:
            signal.signal(kind, _end_at_signal)
    watch()
    # Processes started by this one search modules where this process does, and not in
    # the working directory, whose content may be foreign.
    os.environ.setdefault("PYTHONSAFEPATH", "1")
    # Values that are not finite are reported by lagsim, with their place.
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    # Loading and deriving create many objects and no garbage; repeated searches for
    # garbage would take longer than the integration.
    gc.disable()
    # The start of a thread for each core takes longer than the computations with the
    # small matrices here; OpenBLAS reads the variable when numpy loads it.
    if "OMP_NUM_THREADS" not in os.environ:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # The docstrings of numpy's compiled functions are not needed here.
    for name in ("numpy._core._add_newdocs", "numpy._core._add_newdocs_scalars"):
        sys.modules.setdefault(name, ModuleType(name))
    code = main()
    gc.freeze()
    return code


def end_at_once(code: int) -> NoReturn:
    """End the process without the clean-up of the interpreter; `code` is its exit code.

    The clean-up frees LLVM also while a thread compiles: the process would crash, or
    wait without end for a lock of this thread.
    """
    files.remove_passing()
    os._exit(code)


def _end_at_signal(number: int, _frame: object) -> NoReturn:
    """Signal handler: end the process at once; in force while no command is at work.

    number : the number of the signal.
    """
    end_at_once(128 + number)


def _application() -> typer.Typer:
    import typer

    from lagsim.cli._faults import reporting
    from lagsim.cli._shared import ask_version

    # Only the called command is loaded; without a command all are loaded, for help and
    # for completion by the shell.
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
        # As `short_help` the summary is wrapped; a summary derived from the long help
        # would be truncated.
        summary = (command.__doc__ or "").partition("\n")[0]
        app.command(name, short_help=summary)(reporting(command))
    return app


def _helped() -> contextlib.AbstractContextManager[None]:
    """Return a context manager within which second processes may be started."""
    if is_watched() and sys.argv[1:2] and sys.argv[1] in COMPILED_BY_TWO:
        return second_processes()
    return contextlib.nullcontext()


def _guarded(application: Callable[[], typer.Typer]) -> int:
    """Create and call the command line; return the exit code.

    An unforeseen exception is reported as a bug, with exit code 70.

    application : function that creates the application of typer.
    """
    import typer

    from lagsim.cli import _shared

    try:
        words = [word for word in sys.argv[1:] if word != "--traceback"]
        for word in words:
            if "\n" in word or "\r" in word:
                raise typer.BadParameter(f"{word!r} has a line break")  # noqa: TRY301
        code = application()(words, prog_name="lagsim", standalone_mode=False)
        _shared.write_stdout(lambda: None)
    except typer.Exit as ending:
        return int(ending.exit_code)
    except SystemExit as done:  # a shell has requested the completion of a line
        return int(done.code or 0)
    except typer.Abort:
        raise KeyboardInterrupt from None
    except Exception as error:  # noqa: BLE001  the last resort of a command line
        raise_pending_signal()
        if callable(getattr(error, "show", None)):  # a usage error
            return _usage(error)
        if isinstance(error, OSError) and error.errno == errno.ENOSPC:
            return _shared.report_stdout_failure(error)  # help, written to a full disk
        from lagsim.cli._faults import unforeseen

        return unforeseen()
    return code if isinstance(code, int) else 0


def _usage(error: Any) -> int:
    """Report an error of the command line; return the exit code 2."""
    from lagsim.cli import _shared
    from lagsim.cli._faults import errors_document
    from lagsim.cli._shared import show_json

    if type(error).__name__ == "NoArgsIsHelpError":
        # This is no error, so the help page is printed without an error number.
        _shared.print_stderr(error.format_message())
        return 2
    if getattr(error, "possibilities", None) and hasattr(error, "option_name"):
        _suggest(error)
    text = getattr(error, "format_message", lambda: str(error))()
    problem = Problem(USAGE, text)
    if "--json" in sys.argv[1:]:
        show_json(errors_document([problem]))
    else:
        with contextlib.redirect_stderr(io.StringIO()) as shown:
            error.show()
        text = shown.getvalue().rstrip("\n")
        _shared.print_stderr(f"{text} [{problem.number}]")
    return 2


def _suggest(error: Any) -> None:
    """Add the options that resemble an unknown option to its error message."""
    from difflib import get_close_matches

    # With dashes all options look similar.
    given = error.option_name.lstrip("-")
    options = [o for p in error.ctx.command.params for o in p.opts if o[:2] == "--"]
    names = [o[2:] for o in [*options, "--help"]]
    near = get_close_matches(given, names, 2)
    near = near or [o for o in names if o.startswith(given)][:2]
    error.possibilities = None
    if near:
        found = " or ".join(f"--{option}" for option in near)
        error.message = f"{error.message}. Did you mean {found}?"


# --- Signals that end the process, in order if time permits
#
# Python calls signal handlers between two of its own instructions. Code that stays long
# in one instruction (LLVM, LAPACK), or that loses the exception that a handler raises,
# would never end; therefore a thread receives the signals as well, and ends the process
# if it has not ended by itself.

# Time limits for an orderly end, in s: after one signal while no file is written, and
# after a second signal.
GRACE_SECONDS = 0.7
SECOND_GRACE_SECONDS = 0.3
_GLANCE_SECONDS = 0.05


def raise_pending_signal() -> None:
    """Raise the exception of a received signal again, if there was a signal.

    Other code may have caught and discarded the first exception.
    """
    if heard:
        raise exception_of(heard[0])


def watch() -> None:
    """Start a thread that ends this process after a signal, at any time."""
    sys.unraisablehook = _report_uncaught
    if sys.platform != "win32":  # here the wake-up file descriptor may be a socket only
        reads, writes = os.pipe()
        os.set_blocking(writes, False)
        signal.set_wakeup_fd(writes, warn_on_full_buffer=False)
        threading.Thread(target=_watch, args=(reads,), daemon=True).start()


def is_watched() -> bool:
    """Whether this process has the exception hooks of the command line."""
    return sys.unraisablehook is _report_uncaught


@contextlib.contextmanager
def signals_raised() -> Iterator[None]:
    """Context manager: turn signals into exceptions.

    It has an effect in the main thread, on signals that are not ignored.
    """

    def stop(number: int, _frame: object) -> NoReturn:
        heard.append(number)
        raise exception_of(number)

    heard.clear()
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {kind: signal.signal(kind, stop) for kind in ENDING if not ignored(kind)}
    try:
        yield
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)


def _report_uncaught(raised: sys.UnraisableHookArgs) -> None:
    """Report an uncaught exception, unless it is that of a signal."""
    if raised.exc_type not in (KeyboardInterrupt, Terminated):
        sys.__unraisablehook__(raised)


def _watch(reads: int) -> None:
    """End the process some time after a signal, unless the main thread has ended it.

    reads : file descriptor from which the numbers of signals are read.
    """
    number = os.read(reads, 1)[0]
    import select

    first, again = time.monotonic(), False
    until = first + GRACE_SECONDS
    while True:
        now = time.monotonic()
        if noting() and not again:
            until = now + GRACE_SECONDS
        elif now > until:
            end_at_once(128 + number)
        if select.select([reads], [], [], _GLANCE_SECONDS)[0]:
            number = os.read(reads, 1)[0]
            if not again and time.monotonic() > first + AGAIN_SECONDS:
                until, again = time.monotonic() + SECOND_GRACE_SECONDS, True
