"""Machine, versions and date, on which the numbers of an experiment depend."""

from __future__ import annotations

import os
import platform
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

# What times depend on.
PACKAGES = ("python", "numpy", "llvmlite", "scipy", "heyoka", "scikit-sundae")
# Besides what measures, something else was running.
BUSY = 1.5


def machine() -> dict[str, Any]:
    """Give the processor, the system, and how busy they are."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": platform.system(),
        "load": load,
    }


def today() -> str:
    """Give the date."""
    return datetime.now(UTC).date().isoformat()


def stamp(document: Mapping[str, Any]) -> str:
    """Say in words when, where and with what a document's numbers were found.

    Where and when are left out where they do not matter.
    """
    known = document["versions"]
    packages = [f"{name} {known[name]}" for name in PACKAGES if name in known]
    with_ = ", ".join([f"lagsim {document['lagsim']}", *packages])
    if "machine" not in document:
        return f"Found with {with_}"
    found = document["machine"]
    threads = f"one of {found['cores']} threads"
    where = f"{found['processor']}, {threads}, {found['system']}"
    load = found["load"] or 0.0
    where += f", busy (load {load:.1f})" if load > BUSY else ""
    return f"Measured {document['date']} on {where}; {with_}"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    named = {k.strip(): v.strip() for k, _, v in (x.partition(":") for x in lines)}
    return named.get("model name") or platform.machine()
