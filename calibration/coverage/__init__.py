"""Do the intervals hold the truth as often as they say? Simulated experiments, fitted as a user does."""
