"""Two tables of results: how far apart they are, and whether that is too far.

`reading` reads a table, `scales` says what its columns are measured by, `matching`
finds the rows that belong together, `judging` compares them, `picture` shows the worst.
"""

from lagsim.studies.comparison.judging import Comparison, Deviation, compare, deviations
from lagsim.studies.comparison.reading import Table, read_results, read_table

__all__ = [
    "Comparison",
    "Deviation",
    "Table",
    "compare",
    "deviations",
    "read_results",
    "read_table",
]
