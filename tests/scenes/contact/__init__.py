"""One-sided constraints and laws: whole scenes against closed forms."""
