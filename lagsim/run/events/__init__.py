"""Events of a run: switches in time and state, pulses, impacts, lost rank."""
