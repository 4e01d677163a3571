"""From YAML text to a Model: `nodes`, `reader`, and what they make."""
