"""For all tests."""

import os

os.environ["LENSFIELD_CACHE"] = "off"  # every plan is made, here and in what tests start
