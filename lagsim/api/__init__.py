"""Public Python interface (`import lagsim`), one file for each task."""
