"""`python -m lagsim`."""

import os
import sys

# With `-m` Python searches the working directory first, which may belong to somebody
# else. If lagsim itself is there, the directory is searched last.
if not sys.flags.safe_path:
    here = sys.path.pop(0)
    if __file__ == f"{here}{os.sep}lagsim{os.sep}__main__.py":
        sys.path.append(here)

from lagsim.cli import entry

sys.exit(entry())
