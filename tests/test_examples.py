"""The examples in the docstrings of the public names run."""

import doctest

import pytest

import lensfield


@pytest.mark.parametrize("name", lensfield.__all__)
def test_the_examples_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # they write files
    value = getattr(lensfield, name)
    test, = doctest.DocTestFinder(recurse=False).find(value, name, globs={})
    assert test.examples, "without examples"
    failures = []
    doctest.DocTestRunner(verbose=False).run(test, out=failures.append)
    assert not failures, "".join(failures)
