"""The command, called in this process."""

from tests.cli.conftest import lagsim, write
from tests.cli.test_resume import begun

__all__ = ["begun", "lagsim", "write"]
