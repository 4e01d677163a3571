"""`python -m lagsim`."""

import sys

from lagsim.cli import entry

sys.exit(entry())
