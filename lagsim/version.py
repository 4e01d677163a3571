"""The version, apart from the interface, which knows all rooms."""

__version__ = "0.1.0"
