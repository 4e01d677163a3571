"""The command, called in this process."""

from tests.cli.conftest import lagsim, write

__all__ = ["lagsim", "write"]
