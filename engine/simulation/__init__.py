"""The simulation: channels and their cache, report, and the trade-off of error against time."""
