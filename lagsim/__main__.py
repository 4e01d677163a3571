"""`python -m lagsim`."""

import sys

from lagsim.cli import main

sys.exit(main())
