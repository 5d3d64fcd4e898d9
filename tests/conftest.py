"""Settings for all tests."""

import atexit
import os
import random
import shutil
import tempfile

from seed import SEED
from timing import Times

if "LENSFIELD_CACHE" not in os.environ:  # if it is set, test runs share their baked lenses
    os.environ["LENSFIELD_CACHE"] = tempfile.mkdtemp(prefix="lensfield-tests-")
    atexit.register(shutil.rmtree, os.environ["LENSFIELD_CACHE"], ignore_errors=True)


def pytest_configure(config):
    if not config.getoption("collectonly"):
        config.pluginmanager.register(Times())


def pytest_collection_modifyitems(config, items):
    """Run only some cases of each function marked `sample(number)`, chosen by SEED; all with ALL_CASES=yes, or if the
    command line names a case."""
    if os.environ.get("ALL_CASES") or any("[" in argument for argument in config.args):
        return
    cases = {}
    for item in items:
        if item.get_closest_marker("sample"):
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    left = set()
    for name, of_function in cases.items():
        number, = of_function[0].get_closest_marker("sample").args
        left.update(random.Random(f"{SEED} {name}").sample(of_function, max(len(of_function) - number, 0)))
    config.hook.pytest_deselected(items=[item for item in items if item in left])
    items[:] = [item for item in items if item not in left]
