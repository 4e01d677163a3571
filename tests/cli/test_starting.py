"""What a warm run loads: that takes longer than to integrate."""

from __future__ import annotations

import json
import subprocess
import sys

from tests.support import MODELS

CODE = """
import dataclasses, json, sys
from lagsim.cli import main
sys.argv = ["lagsim", *sys.argv[1:]]
code = main()
own = {name: m for name, m in sys.modules.items() if name.split(".")[0] == "lagsim"}
made = {
    x for m in own.values() for x in vars(m).values()
    if isinstance(x, type) and dataclasses.is_dataclass(x) and x.__module__ in own
}
print(json.dumps([code, sorted(own), sorted(x.__name__ for x in made)]))
"""
# What writes code, of which a warm run has the objects; what few scenes come to.
SELDOM = {
    "lagsim.admissibility.examination",
    "lagsim.derivation",
    "lagsim.mechanics.pushes",
    "lagsim.mechanics.eigenmodes",
    "lagsim.mechanics.equilibrium",
    "lagsim.mechanics.linearisation",
    "lagsim.mechanics.reduction.elimination",
    "lagsim.native.graph.straight_line",
    "lagsim.native.graph.tapes",
    "lagsim.native.kernels.code",
    "lagsim.native.kernels.source",
    "lagsim.native.kernels.statements",
    "lagsim.native.graph.keys",
    "lagsim.outputs.attempted",
    "lagsim.outputs.plots",
    "lagsim.run.held",
    "lagsim.run.events.switching",
    "lagsim.studies.beside",
}
# What looks at a start, which the session that a warm run begins with has behind it.
EXAMINED = {"lagsim.admissibility.examination"}
# Dataclasses of what reads a file.
READING = 5
# Python compiles six methods of each at every start, 0.5 ms: what is made anew with
# changes, is mutable or has a base. All else is a NamedTuple.
MOST_DATACLASSES = 7
# 0.2 ms each, were they empty. Every start heeds signals and mistrusts files.
MOST_MODULES = 128


def loaded(*arguments: str) -> tuple[set[str], list[str]]:
    """Give the modules of lagsim, and its dataclasses, that a command loads."""
    command = [sys.executable, "-c", CODE, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    code, modules, made = json.loads(done.stdout.splitlines()[-1])
    assert code == 0
    return set(modules), made


def test_a_warm_run_loads_what_it_needs(tmp_path):
    command = ["run", str(MODELS / "kepler.yaml"), "--no-plots", "-q"]
    command += ["-o", str(tmp_path / "results"), "--duration", "1"]
    loaded(*command)  # now its objects are kept
    modules, made = loaded(*command)
    assert modules & SELDOM == set()
    assert len(modules) <= MOST_MODULES
    assert len(made) <= MOST_DATACLASSES


def test_a_check_loads_no_more_than_a_run():
    modules, made = loaded("check", "--json", str(MODELS / "kepler.yaml"))
    assert modules & (SELDOM - EXAMINED) == set()
    assert len(made) <= MOST_DATACLASSES + READING
