"""The same motion, told in other words."""
