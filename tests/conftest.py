"""For all tests."""

import atexit
import os
import shutil
import tempfile

if "LENSFIELD_CACHE" not in os.environ:  # given, it lets several runs of tests share the lenses that they bake
    os.environ["LENSFIELD_CACHE"] = tempfile.mkdtemp(prefix="lensfield-tests-")
    atexit.register(shutil.rmtree, os.environ["LENSFIELD_CACHE"], ignore_errors=True)
