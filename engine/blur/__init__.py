"""The ways to spread the light of every point by its point spread function; a module each."""
