"""The field of a rotationally symmetric lens: tables over height, with PSFs turned to each azimuth."""
