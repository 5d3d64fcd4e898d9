"""Which values are numbers, of types of Python or numpy."""

from typing import Any, TypeGuard

import numpy as np


def is_integer(value: object) -> bool:
    """Whether a value is an integer, of any numeric type."""
    return is_number(value) and bool(np.isfinite(value)) and value == int(value)


def is_positive(value: object) -> bool:
    """Whether a value is a finite number above 0."""
    return is_number(value) and bool(0 < value < np.inf)


def is_number(value: Any) -> TypeGuard[float]:
    """Whether a value is a number: not a truth value."""
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
