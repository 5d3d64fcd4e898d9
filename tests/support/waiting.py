"""Wait for events in tests, because a verdict must not depend on the speed of the machine.

A test must neither fail because something took some number of seconds nor pass because that many were enough. Wait for
the event itself, and count work (calls, bytes) where the test is about cost.
"""

import time

LAST_RESORT_S = 1800.0
"""Only ends a hang: hundreds of times longer than any event in the tests takes on two busy cores."""


def wait_until(holds, pause_s=0.02):
    """Wait until a function returns a true value, and return that value."""
    end_s = time.monotonic() + LAST_RESORT_S
    while not (result := holds()):
        assert time.monotonic() < end_s, "a hang: the last resort of tests/support/waiting.py has ended it"
        time.sleep(pause_s)
    return result
