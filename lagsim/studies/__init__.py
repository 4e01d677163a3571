"""What runs a model several times, or judges what a run gave."""
