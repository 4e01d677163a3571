"""Is the initial state admissible? `examine` solves, judges and repairs it."""

from lagsim.admissibility.examination import Examination, examine
from lagsim.admissibility.start import Start
from lagsim.admissibility.verdict import Verdict

__all__ = ["Examination", "Start", "Verdict", "examine"]
