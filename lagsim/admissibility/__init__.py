"""Is the initial state admissible? `examine` solves, judges and repairs it."""

from lagsim.admissibility.examination import StartReport, examine
from lagsim.admissibility.start import Start
from lagsim.admissibility.verdict import Verdict

__all__ = ["Start", "StartReport", "Verdict", "examine"]
