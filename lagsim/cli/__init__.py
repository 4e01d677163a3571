"""The commands, one file each; the only place that prints or exits."""

from __future__ import annotations

import sys
import time

_BEGAN = time.perf_counter()


def main() -> int:
    """Run the command line; give the exit code."""
    import typer

    from lagsim.cli import check, methods, run
    from lagsim.cli._shared import ask_version

    app = typer.Typer(
        name="lagsim",
        help="From energies to motion: simulate a system written down as T and V.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(ask_version)
    app.command("run")(run.command)
    app.command("check")(check.command)
    app.command("methods")(methods.command)
    return _guarded(app)


def _guarded(app: object) -> int:
    """Call the application; anything unforeseen is a bug, exit 70."""
    import typer

    assert isinstance(app, typer.Typer)
    try:
        code = app(standalone_mode=False)
    except typer.Exit as wish:
        return int(wish.exit_code)
    except typer.Abort:
        return 130
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 0
    except Exception as error:  # noqa: BLE001  the last resort of a command line
        show = getattr(error, "show", None)  # click's usage errors show themselves
        if callable(show):
            show()
            return 2
        return _bug()
    return code if isinstance(code, int) else 0


def _bug() -> int:
    import traceback

    traceback.print_exc()
    print(
        "\nThis is a bug in lagsim, not in your model. Please report it with the "
        "model file and the lines above.",
        file=sys.stderr,
    )
    return 70
