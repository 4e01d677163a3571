"""Is the initial state admissible? `examination` solves, judges and repairs it."""
