"""A running co-simulation is reached from elsewhere, and components may be there."""
