"""Is the initial state admissible? `examine` solves, judges and repairs it."""

from lagsim.admissibility.start import Start, examine
from lagsim.admissibility.verdict import Verdict

__all__ = ["Start", "Verdict", "examine"]
