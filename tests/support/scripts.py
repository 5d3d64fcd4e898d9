"""Scripts of folders that are not importable, as modules."""

import importlib.util

from places import ROOT


def script(path):
    """The module of a script, by its path in the repository: packaging/moderate.py, say."""
    file = ROOT / path
    specification = importlib.util.spec_from_file_location(file.stem, file)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module
