"""Events of a run: switches in time and state, pulses, impacts, lost rank.

Shapes: size is the number of components of the state y, n that of coordinates, l that
of first-order states, K that of switching surfaces, L that of laws, C that of
conditions, r that of the laws or rows in one problem. Surfaces, laws, conditions and
events of the file are identified by their indices, from 0. The state reached is the
state in the memory of an arc at its present time.
"""
