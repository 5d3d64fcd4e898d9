"""What materials, lights and worlds are in spectra: judged by the linter, substituted for the render."""
