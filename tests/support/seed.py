"""The seed of a test run: `make test SEED=n` runs all tests with different noise, for any integer n."""

import os

SEED = int(os.environ.get("SEED", 0)) % 2**21
FIRST_CYCLES_SEED = 1000 * SEED
"""The smallest seed of any render. Each run has 1000 seeds to itself, below Cycles' limit of 2^31."""
