"""Looking at methods rather than at a scene: what each costs, and where it fails."""
