"""Model files: YAML text (`loading`) to nodes, and nodes (`reader`) to a Model."""
