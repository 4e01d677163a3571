"""Is the initial state admissible? `examine` solves, judges and repairs it."""

from lagsim.admissibility.start import Start, Verdict, examine

__all__ = ["Start", "Verdict", "examine"]
