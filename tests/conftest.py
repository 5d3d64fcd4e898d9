"""Settings for all tests."""

import atexit
import os
import shutil
import tempfile

if "LENSFIELD_CACHE" not in os.environ:  # if it is set, several test runs share the lenses that they bake
    os.environ["LENSFIELD_CACHE"] = tempfile.mkdtemp(prefix="lensfield-tests-")
    atexit.register(shutil.rmtree, os.environ["LENSFIELD_CACHE"], ignore_errors=True)
