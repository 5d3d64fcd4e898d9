"""Settings for all tests."""

import atexit
import os
import random
import shutil
import tempfile
from pathlib import Path

from processor_times import Times
from seed import SEED

HEAVY_TESTS = frozenset(Path(__file__).with_name("heavy.txt").read_text(encoding="utf-8").splitlines())
"""Functions whose cases take over 2 processor seconds together, with ALL_CASES=yes: `make heavy` lists them."""

if "LENSFIELD_CACHE" not in os.environ:  # if it is set, test runs share their baked lenses
    os.environ["LENSFIELD_CACHE"] = tempfile.mkdtemp(prefix="lensfield-tests-")
    atexit.register(shutil.rmtree, os.environ["LENSFIELD_CACHE"], ignore_errors=True)


def pytest_configure(config):
    if not config.getoption("collectonly"):
        config.pluginmanager.register(Times())


def pytest_collection_modifyitems(config, items):
    """Leave out tests that SEED chooses; none with ALL_CASES=yes, or if the command line names a test."""
    if os.environ.get("ALL_CASES"):
        return
    left = set(_cases_left_out(config, items))
    left |= set(_heavy_left_out(config, [item for item in items if item not in left]))
    config.hook.pytest_deselected(items=[item for item in items if item in left])
    items[:] = [item for item in items if item not in left]


def _heavy_left_out(config, items):
    """All heavy tests but one in HEAVY; by default none of files that the command line names, and otherwise all but one
    in 6: generator of items. Tests that represent a kind of pass always run."""
    named = any(".py" in argument for argument in config.args)
    one_in = int(os.environ.get("HEAVY") or (1 if named else 6))
    if any("::" in argument for argument in config.args):
        return
    heavy = [item for item in items
             if _function(item) in HEAVY_TESTS and not item.get_closest_marker("every_blender")]
    yield from (item for number, item in enumerate(heavy) if (number + SEED) % one_in)


def _cases_left_out(config, items):
    """The cases of functions marked `sample(number)` in excess of that number: generator of items."""
    if any("[" in argument for argument in config.args):
        return
    cases = {}
    for item in items:
        if item.get_closest_marker("sample"):
            cases.setdefault(_function(item), []).append(item)
    for name, of_function in cases.items():
        number, = of_function[0].get_closest_marker("sample").args
        yield from random.Random(f"{SEED} {name}").sample(of_function, max(len(of_function) - number, 0))


def _function(item):
    """The name of a test without its case."""
    return item.nodeid.partition("[")[0]
