"""What a time was measured on."""

from __future__ import annotations

import os
import platform
from pathlib import Path
from typing import Any


def machine() -> dict[str, Any]:
    """Give the processor, the system, and how busy they are."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": platform.system(),
        "load": load,
    }


def described(found: dict[str, Any]) -> str:
    """Give the same in words."""
    return f"{found['processor']}, {found['cores']} cores, {found['system']}"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    named = {k.strip(): v.strip() for k, _, v in (x.partition(":") for x in lines)}
    return named.get("model name") or platform.machine()
