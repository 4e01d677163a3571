"""Features in pairs: docs/pairs.md is the table."""
