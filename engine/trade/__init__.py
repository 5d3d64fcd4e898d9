"""Error against time and memory, measured and drawn."""
