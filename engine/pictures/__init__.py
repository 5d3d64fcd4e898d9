"""Picture files: spectral, layered and deep EXR, colour pictures, previews."""
