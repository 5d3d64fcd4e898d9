"""The lens at each place in the field: distortion, relative illumination, point spread functions, rays."""
