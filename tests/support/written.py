"""Texts on the pages of sheets, and whether they are legible."""

from contextlib import contextmanager
from itertools import combinations

import pytest

from lensfield.engine.inspection.canvas import Page


@contextmanager
def written():
    """Record the page, the text and the box of all texts: a list of triples."""
    texts, write = [], Page.write

    def recording(page, x, y, text, *size, **style):
        box = write(page, x, y, text, *size, **style)
        texts.append((page, text, box))
        return box

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Page, "write", recording)
        yield texts


def check_legible(texts):
    """No text is cut by the edge of its page, and none covers another."""
    visible = [each for each in texts if each[1].strip()]
    assert visible
    for page, text, box in visible:
        assert box.left >= 0 and box.bottom >= 0 and box.right <= page.width and box.top <= page.height, (text, box)
    for (page, text, box), (other_page, other, other_box) in combinations(visible, 2):
        assert page is not other_page or not box.overlaps(other_box), (text, other)
