"""From YAML text (`loading`) to nodes, and from them (`reader`) to a Model."""
