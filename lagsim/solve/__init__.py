"""Other forms of the motion: solved for by loops, as series, along surfaces."""
