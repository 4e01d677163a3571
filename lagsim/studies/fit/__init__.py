"""Fits: the values of parameters and start values with which a run explains data."""
