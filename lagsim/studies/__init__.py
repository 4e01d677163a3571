"""Studies that run a model several times, or judge the result of a run."""
