"""`python -m lagsim`."""

import os
import sys

# `-m` has Python look for modules in the working directory first, which may be a
# stranger's. Where lagsim itself is there, it is last.
if not sys.flags.safe_path:
    here = sys.path.pop(0)
    if __file__ == f"{here}{os.sep}lagsim{os.sep}__main__.py":
        sys.path.append(here)

from lagsim.cli import entry

sys.exit(entry())
