"""Expression language: text, hash-consed graph, values and derivatives."""
