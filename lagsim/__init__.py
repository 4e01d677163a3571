"""From energies to motion: a simulator for systems written down as T and V."""

__version__ = "0.1.0"
