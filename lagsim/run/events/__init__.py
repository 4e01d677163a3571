"""What happens on the way: switches in time and state, features, impacts, lost rank."""
