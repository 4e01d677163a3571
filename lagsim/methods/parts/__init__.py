"""What integration methods share: tableaus, step control, projection, the loop."""
