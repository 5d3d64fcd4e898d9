"""Rays through a prescription: aiming, focus, rings, and the table of rays from the sensor to the scene."""
