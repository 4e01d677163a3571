"""Expressions: text -> hash-consed graph -> values and derivatives."""
