"""From energies to motion: a simulator for systems written down as T and V."""
