"""What a scene needs, and why: formulation, solve, method."""
