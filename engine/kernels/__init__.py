"""The inner loops in C. On a machine without their compiled library, numpy is used instead.

Check `library.running` before calling `turn`, `footprints`, `extremes`, `excess`, `spread`, `waves`, `spots` or
`cast`, each in a module of its own: if it returns "numpy", the library is missing.
"""
