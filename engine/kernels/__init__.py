"""The inner loops in C. On a machine without their compiled library, numpy is used instead. A GPU can cast and spread.

Check `library.running` before calling `turn`, `footprints`, `extremes`, `excess`, `spread`, `waves`, `trace`, `aim`,
`spots` or `cast`: if it returns "numpy", the library is missing.
"""
