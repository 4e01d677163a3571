"""Events of a run: switches in time and state, features, impacts, lost rank."""
