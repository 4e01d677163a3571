"""Kills at random moments, some inside the renames: the files left are complete.

    python -m tests.hunt.kills SEED COUNT FOLDER

A process with loaded modules forks for each kill. Half of the forks die at the n-th
call that touches files, the others within the time that the command takes. The folder
must then hold a complete result, the old one or the new one, and the next run must
succeed.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import sys
import time
from collections import Counter
from pathlib import Path

from lagsim.cli import main
from lagsim.studies.golden import load
from tests.small_scenes import PENDULUM

TOUCHING = ("open", "write", "replace", "rename", "fsync", "unlink", "link", "mkdir")
OTHER = PENDULUM.replace("l: 1", "l: 2")
LINES = (
    ("run", "pendulum.yaml", "-o", "found", "--no-plots", "-q"),
    ("run", "pendulum.yaml", "-o", "found", "--animate", "--no-plots", "-q"),
    ("golden", "pendulum.yaml", "--dir", "found", "--update", "-q"),
    ("derive", "pendulum.yaml", "-o", "found/equations.txt"),
    ("sweep", "pendulum.yaml", "g=9,10", "-o", "found", "-j", "1", "-q"),
)
# More calls than any of these commands makes are not asked for.
MOST_CALLS = 60
# Whether the next run goes through is asked after one kill of so many.
NEXT_ONE_IN = 3


def called(line):
    """Call the command in this process."""
    sys.argv = ["lagsim", *line]
    return main()


def killed(line, moment):
    """Call the command in a fork that dies at a moment; return whether it has died."""
    pid = os.fork()
    if pid == 0:
        if isinstance(moment, int):
            _die_at(moment)
        try:
            called(line)
        finally:
            os._exit(0)
    if isinstance(moment, float):
        time.sleep(moment)
        os.kill(pid, signal.SIGKILL)
    return os.WIFSIGNALED(os.waitpid(pid, 0)[1])


def _die_at(number):
    """Kill this process at the n-th call that touches files, before or after it."""
    left = [number // 2]

    def counted(call):
        def counting(*arguments, **keywords):
            left[0] -= 1
            if left[0] < 0 and number % 2 == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            answer = call(*arguments, **keywords)
            if left[0] < 0:
                os.kill(os.getpid(), signal.SIGKILL)
            return answer

        return counting

    for name in TOUCHING:
        setattr(os, name, counted(getattr(os, name)))


def wrong(folder, whole):
    """Return a text on an incomplete folder, or ""; `whole` are the equations."""
    names = {path.name for path in folder.iterdir()}
    for record in ("run.json", "sweep.json"):
        if record in names:
            found = json.loads((folder / record).read_bytes())
            lost = set(found["files"]) - names
            if lost:
                return f"{record} without {sorted(lost)}"
    if "run.json" in names:
        rows = (folder / "trajectory.csv").read_bytes().count(b"\n") - 1
        said = json.loads((folder / "run.json").read_bytes())["rows"]
        if rows != said:
            return f"{rows} rows, and run.json says {said}"
    if "pendulum.json" in names:  # the record, taken away first and put back last
        load(folder, "pendulum")
    if "equations.txt" in names:
        text = (folder / "equations.txt").read_bytes()
        if text != whole:
            return f"{len(text)} of {len(whole)} bytes of the equations"
    return ""


def hunt(seed, count, folder):
    """Kill `count` times; return the counts, and the faults found."""
    os.chdir(folder)
    os.environ["LAGSIM_CACHE"] = str(folder / "cache")
    texts, whole, seconds = {"one": PENDULUM, "other": OTHER}, b"", {}
    for line in LINES:  # warm: all is imported and compiled
        for text in texts.values():
            Path("found").mkdir(exist_ok=True)
            Path("pendulum.yaml").write_text(text)
            before = time.perf_counter()
            assert called(line) == 0
            seconds[line] = time.perf_counter() - before  # the last one is warm
            if Path("found/equations.txt").exists():
                whole = Path("found/equations.txt").read_bytes()
            shutil.rmtree("found")
    counts: Counter[str] = Counter()
    faults = []
    rng = random.Random(seed)
    for number in range(count):
        line = LINES[number % len(LINES)]
        kept = Path(f"kept-{number % len(LINES)}")
        if number // len(LINES) % 4 and kept.exists():
            kept.rename("found")
        else:
            shutil.rmtree(kept, ignore_errors=True)
            Path("found").mkdir()
        Path("pendulum.yaml").write_text(texts[rng.choice(("one", "other"))])
        moment = rng.randrange(MOST_CALLS) if number % 2 else None
        late = rng.uniform(0.0, seconds[line])
        died = killed(line, late if moment is None else moment)
        counts["died" if died else "ended before"] += 1
        why = _judged(line, whole, again=number % NEXT_ONE_IN == 0)
        if why:
            faults.append(f"seed {seed}, kill {number}, {' '.join(line)}: {why}")
        Path("found").rename(kept)
    return {"seed": seed, "kills": count, **counts, "faults": faults}


def _judged(line, whole, *, again):
    try:
        why = wrong(Path("found"), whole)
    except Exception as error:  # noqa: BLE001  whatever it is, it is told
        return repr(error)
    if why or not again:
        return why
    if called(line) != 0:
        return "the next one does not go through"
    left = [p.name for p in Path("found").iterdir() if p.name.startswith(".")]
    if line[0] == "derive":  # it holds no folder whose rests it could take away
        left = [name for name in left if not name.endswith(".new")]
    return f"{left} are left" if left else ""


if __name__ == "__main__":
    seed, count = map(int, sys.argv[1:3])
    folder = Path(sys.argv[3]).absolute()
    folder.mkdir(parents=True, exist_ok=True)
    print(json.dumps(hunt(seed, count, folder)), file=sys.__stdout__)
