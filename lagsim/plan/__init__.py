"""The plan of a run, with reasons: formulation, solve, method."""
