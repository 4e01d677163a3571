"""From energies to motion: a simulator for systems written down as T and V.

`load` reads a model, `check` examines its start, `simulate` returns its motion as
arrays, `sweep` a table of runs at many values, and `derive` its equations: see
docs/python.md. No function prints, and only the `write` methods of results write files.

Examples
--------
A mass that falls for half a second:

>>> import lagsim
>>> model = lagsim.load('''
... name: drop
... parameters: {m: 2, g: 9.81}
... coordinates: {y: {}}
... energy: {kinetic: m*y_dot^2/2, potential: m*g*y}
... initial: {y: 1, y_dot: 0}
... simulation: {duration: 0.5}
... ''')
>>> motion = lagsim.simulate(model)
>>> round(float(motion["y"][-1]), 9)
-0.22625
"""

from __future__ import annotations

import signal
import sys

# A command that is interrupted while it loads ends without a message from here on. A
# program that imports lagsim keeps its own handler of SIGINT.
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
    from lagsim.api.analysing import Equilibria, Modes, equilibrium, modes
    from lagsim.api.fitting import Fitted, fit
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
    "Equilibria",
    "Examination",
    "Fitted",
    "InadmissibleError",
    "InputError",
    "LagsimError",
    "Model",
    "Modes",
    "Result",
    "Sweep",
    "__version__",
    "check",
    "derive",
    "equilibrium",
    "fit",
    "load",
    "modes",
    "simulate",
    "sweep",
]

# The modules of `lagsim.api` that define the public names. They are imported at the
# first access of a name, since every command imports this file, too.
_PLACES = {
    "Derivation": "models",
    "Equilibria": "analysing",
    "Examination": "simulating",
    "Fitted": "fitting",
    "InadmissibleError": "simulating",
    "Model": "models",
    "Modes": "analysing",
    "Result": "simulating",
    "Sweep": "sweeping",
    "check": "simulating",
    "derive": "models",
    "equilibrium": "analysing",
    "fit": "fitting",
    "load": "models",
    "modes": "analysing",
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
