"""Invariance of the motion of a model under changes of its form."""
