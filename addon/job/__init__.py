"""The main job, step by step: the scene's plan, its passes, their radiance, the lens image."""
