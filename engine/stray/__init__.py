"""Stray light in watts: ghosts by reflections between surfaces, veiling glare, and stars by the blades of the iris."""
