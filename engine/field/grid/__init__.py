"""The field map of lenses without rotational symmetry, in rows and columns of nodes on the sensor."""
