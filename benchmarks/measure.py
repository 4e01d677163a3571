"""Measuring side by side: candidates take turns, and each turn is timed."""

from __future__ import annotations

import math
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path

HERE = Path(__file__).resolve().parent
MODELS = HERE.parent / "models"
PACKAGES = ["lagsim", "numpy", "scipy", "sympy", "matplotlib"]
PACKAGES += ["llvmlite", "orjson", "PyYAML", "typer"]
LAGSIM = str(Path(sys.executable).parent / "lagsim")


@dataclass
class Timed:
    """The seconds of one candidate, turn by turn."""

    seconds: list[float] = field(default_factory=list)

    @property
    def least(self) -> float:
        return min(self.seconds)

    @property
    def median(self) -> float:
        return statistics.median(self.seconds)


@dataclass(frozen=True)
class Table:
    """One table of the report: title, head, rows, and notes below."""

    title: str
    head: list[str]
    rows: list[list[str]]
    notes: list[str]

    def markdown(self):
        lines = [f"## {self.title}", ""]
        lines += [f"| {' | '.join(self.head)} |", "|" + "---|" * len(self.head)]
        lines += [f"| {' | '.join(row)} |" for row in self.rows]
        lines += ["", *(f"- {note}" for note in self.notes)]
        return "\n".join(lines) + "\n"


def alternate(candidates, turns, warm=1):
    """Time callables in turn; return name -> Timed.

    A callable may return its own time, in seconds.

    turns : the number of measurements of each.
    warm : the number of turns before, which are not counted.
    """
    times = {name: Timed() for name in candidates}
    for turn in range(-warm, turns):
        for name, call in candidates.items():
            began = time.perf_counter()
            own = call()
            passed = time.perf_counter() - began if own is None else own
            if turn >= 0:
                times[name].seconds.append(passed)
    return times


def ratio(slow, fast):
    """Return a speed-up as text: of least times, and in parentheses of medians."""
    least, median = slow.least / fast.least, slow.median / fast.median
    return f"{least:.3g} (medians {median:.3g})"


@dataclass(frozen=True)
class Process:
    """A finished process: elapsed seconds, output, and processor time in seconds."""

    seconds: float
    output: str
    cpu: float


def process(command, **environment):
    """Run a command to its end; `environment` is added to this one's."""
    with tempfile.TemporaryFile() as out:
        began, used = time.perf_counter(), _children()
        child = subprocess.run(
            [str(part) for part in command],
            stdout=out,
            stderr=subprocess.STDOUT,
            env={**os.environ, **{k: str(v) for k, v in environment.items()}},
            check=False,
        )
        passed, cpu = time.perf_counter() - began, _children() - used
        out.seek(0)
        text = out.read().decode()
    if child.returncode:
        raise RuntimeError(f"exit {child.returncode}: {command}\n{text}")
    return Process(passed, text, cpu)


def _children():
    """Return the processor time (s) of all processes that this one waited for."""
    ended = os.times()
    return ended.children_user + ended.children_system


# A process starts with the peak of the one that starts it: start it from a small one.
PEAK = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True)
peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
print(peak / 2 ** (20 if sys.platform == "darwin" else 10))
"""


def peak(command, **environment):
    """Run a command; return its peak memory in MB, and the finished process."""
    done = process([sys.executable, "-S", "-c", PEAK, *command], **environment)
    *said, megabytes = done.output.splitlines()
    return float(megabytes), Process(done.seconds, "\n".join(said), done.cpu)


@contextmanager
def workspace():
    """Context manager: a folder for results that is removed at the end."""
    with tempfile.TemporaryDirectory(prefix="lagsim-benchmarks-") as folder:
        yield Path(folder)


def read_rows(path):
    """Return the table of a run as an array (rows, columns)."""
    import numpy as np

    return np.loadtxt(path, delimiter=",", skiprows=1)


def cost_at(curve, error):
    """Return the cost at an error on a curve; None if no error is so small.

    The curve is in the order of the sweep, from loose to tight. Between neighbouring
    points it is a straight line in logarithms.
    """
    costs = [cost for reached, cost in curve if reached <= error]
    for (loose, less), (tight, more) in pairwise(curve):
        if loose > error >= tight > 0.0 and less > 0.0 < more:
            part = math.log(loose / error) / math.log(loose / tight)
            costs.append(less * (more / less) ** part)
    return min(costs, default=None)


def ms(timed):
    """Write the least and the median in milliseconds."""
    return [f"{timed.least * 1e3:.3g}", f"{timed.median * 1e3:.3g}"]


def machine(turns):
    """Describe the machine and the versions in a few lines."""
    versions = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    return [
        f"{_cpu()}, {os.cpu_count()} cores, {platform.system()}",
        f"Python {platform.python_version()}, {versions}",
        f"{turns} turns; load of the machine when this ended {os.getloadavg()[0]:.1f}",
    ]


def _cpu():
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    named = {
        k.strip(): v.strip() for k, _, v in (line.partition(":") for line in lines)
    }
    name = named.get("model name", platform.machine())
    family, model = named.get("cpu family", "?"), named.get("model", "?")
    return f"{name} (family {family}, model {model})"
