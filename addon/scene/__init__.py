"""Blender's scene: its rendered objects, its camera and settings (restored after a render), and its compositor."""
