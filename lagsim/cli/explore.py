"""`lagsim explore`: a page on which values are set and the motion follows."""

from __future__ import annotations

import gc
import webbrowser
from pathlib import Path

import typer

from lagsim.cli import end_at_once, is_watched
from lagsim.cli._faults import error_text
from lagsim.cli._shared import (
    SETS,
    assignments,
    flag,
    option,
    parse_range,
    print_stderr,
    write_file,
    write_stdout,
)
from lagsim.codes.known import OUTPUT_FILE, USAGE
from lagsim.errors import Problems, unusable
from lagsim.model.loading import STANDARD_INPUT
from lagsim.studies.options import VARIED_RANGE


def command(
    model: str = typer.Argument(metavar="MODEL", help="Model file."),
    sets: list[str] | None = SETS,
    vary: list[str] | None = option(
        "NAME[=A:B]",
        "A parameter or start value with a slider from A to B; may be repeated. "
        "Default: all plain parameters and all start values.",
        "--vary",
    ),
    output: Path | None = option(
        "FILE.html",
        "Write the page to a file, which computes motions itself, and end.",
        "-o",
        "--output",
    ),
    port: int = typer.Option(0, "--port", min=0, max=65535, help="0: a free one."),
    no_browser: bool = flag("--no-browser", "Print the address, open no browser."),
) -> int:  # fmt: skip
    """Set values on a page and watch the motion follow, until Ctrl-C."""
    from lagsim.studies.explore.explorer import Explorer
    from lagsim.studies.explore.server import HOST, Server

    if output is not None:
        return _written(model, sets, vary, output)
    if model == STANDARD_INPUT:
        text = "explore needs a file, which it reads again when it has been saved"
        raise unusable(USAGE, text)
    explorer = Explorer(model, assignments(sets), _ranges(vary), error_text)
    try:
        server = Server(explorer, port)
    except OSError as error:
        text = f"--port {port}: {HOST} does not offer this port: {error.strerror}"
        hint = "without --port a free one is taken"
        raise unusable(USAGE, text, hint=hint) from None
    # At once, also into a pipe.
    write_stdout(lambda: print(f"{explorer.model.name}: {server.address}", flush=True))
    if not no_browser and not webbrowser.open(server.address):
        print_stderr("no browser was found: open the address above in one")
    print_stderr("Ctrl-C ends")
    # Other commands collect no garbage, since they end soon. This one continues.
    gc.freeze()
    gc.enable()
    try:
        server.serve()
    except KeyboardInterrupt:
        server.end()
    if is_watched():  # a process of its own, in which a request may be at work
        end_at_once(0)
    return 0


def _written(
    model: str, sets: list[str] | None, vary: list[str] | None, output: Path
) -> int:
    """Write the page to a file; return the exit code."""
    from lagsim.studies.explore.explorer import Explorer
    from lagsim.studies.explore.file import page_in_a_file

    why = ""
    if output.is_dir():
        why = "it is a folder"
    elif not output.parent.is_dir():
        why = "there is no such folder"
    elif output.resolve() == Path(model).resolve():
        why = "it is the model"
    if why:
        raise unusable(OUTPUT_FILE, f"{output} cannot be written: {why}")
    explorer = Explorer(model, assignments(sets), _ranges(vary), error_text)
    content = page_in_a_file(explorer)
    write_file(output.resolve() if output.is_file() else output, content)
    write_stdout(
        lambda: print(f"{explorer.model.name}: {output}, {len(content) / 1000:.0f} kB")
    )
    return 0


def _ranges(vary: list[str] | None) -> dict[str, tuple[float, float] | None]:
    """Parse the names to vary; return the ends of each slider, None if not stated."""
    problems, found = Problems(), dict[str, tuple[float, float] | None]()
    for text in vary or ():
        name, equals, after = (part.strip() for part in text.partition("="))
        found[name] = None
        if equals:
            found[name] = parse_range(problems, f"--vary {name}", after, VARIED_RANGE)
    problems.refuse()
    return found
