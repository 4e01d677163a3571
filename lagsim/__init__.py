"""From energies to motion: a simulator for systems written down as T and V.

`load` reads a model, `check` tells whether its start is admissible, `simulate` gives
its motion as arrays, `sweep` what comes of many values, and `derive` its equations: see
docs/python.md. Nothing is printed, and nothing written unless a result is asked to.
"""

from __future__ import annotations

import signal
import sys

# The command that is interrupted while it begins ends without a word, from here on;
# whoever imports this is left alone.
if (
    sys.orig_argv[1:3] == ["-m", "lagsim"]
    or "".join(sys.argv[:1]).endswith(("/lagsim", "\\lagsim.exe"))
) and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from importlib import import_module
from typing import TYPE_CHECKING, Any

from lagsim.errors import InputError, LagsimError
from lagsim.version import __version__

if TYPE_CHECKING:
    from lagsim.api.models import Derivation, Model, derive, load
    from lagsim.api.simulating import (
        Examination,
        InadmissibleError,
        Result,
        check,
        simulate,
    )
    from lagsim.api.sweeping import Sweep, sweep

__all__ = [
    "Derivation",
    "Examination",
    "InadmissibleError",
    "InputError",
    "LagsimError",
    "Model",
    "Result",
    "Sweep",
    "__version__",
    "check",
    "derive",
    "load",
    "simulate",
    "sweep",
]

# What is loaded when it is asked for: commands begin with this file, too.
_PLACES = {
    "Derivation": "models",
    "Examination": "simulating",
    "InadmissibleError": "simulating",
    "Model": "models",
    "Result": "simulating",
    "Sweep": "sweeping",
    "check": "simulating",
    "derive": "models",
    "load": "models",
    "simulate": "simulating",
    "sweep": "sweeping",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module `lagsim` has no attribute `{name}`")
    found = getattr(import_module(f"lagsim.api.{_PLACES[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
