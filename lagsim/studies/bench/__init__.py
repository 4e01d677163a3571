"""Methods compared on a model: work-precision and stability on a given step."""
