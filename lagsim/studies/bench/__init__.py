"""Looking at methods rather than at a model: what each costs, and where it fails."""
