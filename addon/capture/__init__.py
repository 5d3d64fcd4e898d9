"""Scene -> radiance: the scene's plan, its passes, and the radiance, depth and lamps that they show."""
