"""A lens on one sheet of paper."""
