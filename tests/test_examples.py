"""The examples in the docstrings of the engine's exported names run."""

import doctest

import pytest

from lensfield import engine


@pytest.mark.parametrize("name", engine.__all__)
def test_the_examples_run(name):
    value = getattr(engine, name)
    test, = doctest.DocTestFinder(recurse=False).find(value, name, globs={})
    assert test.examples, "without examples"
    failures = []
    doctest.DocTestRunner(verbose=False).run(test, out=failures.append)
    assert not failures, "".join(failures)
