"""What displays and compositors need to know of a lens: tables, curves and maps of its distortion, light and bokeh."""
