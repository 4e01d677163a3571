"""The version of lagsim, in a module that imports no other module."""

__version__ = "0.1.0"
