"""Curves of the light of even fields, and their tables."""

import numpy as np
import pytest

from lensfield.engine import LensError
from lensfield.engine.fitting.vignetting import light_of, read_vignetting
from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.photographs import Vignetting
from refusals import refused

HEAD = "f_number,focus_m,height_mm,light\n"
ROWS = "2,inf,10,0.8\n2,inf,5,0.95\n2,inf,20,0.4\n2,1.5,5,0.97\n2,1.5,10,0.9\n2,1.5,20,0.55\n"


def written(tmp_path, text):
    path = tmp_path / "light.csv"
    path.write_text(text)
    return path


def test_a_table_has_a_curve_for_each_f_stop_and_distance(tmp_path):
    far, near = read_vignetting(written(tmp_path, HEAD + ROWS + "\n"))
    assert (far.f_number, far.focus_mm, near.f_number, near.focus_mm) == (2.0, np.inf, 2.0, 1500.0)
    assert far.heights_mm.tolist() == [5, 10, 20] and far.light.tolist() == [0.95, 0.8, 0.4]
    assert near.light.tolist() == [0.97, 0.9, 0.55]
    assert (str(far), str(near)) == ("f/2 at infinity", "f/2 at 1.5 m")


@pytest.mark.parametrize("text, field, words", [
    ("", "line 1", "expected the columns f_number,focus_m,height_mm,light"),
    ("f,d,h,l\n", "line 1", "expected the columns"),
    (HEAD + "2,inf,10\n", "line 2", "expected an f-number, metres or inf, a height"),
    (HEAD + ROWS + "2,far,10,0.5\n", "line 8", "metres or inf"),
    (HEAD + "2,inf,0,1\n", "line 2", "above 0"),
    (HEAD + "inf,1,10,0.5\n", "line 2", "f-number"),
    (HEAD + "2,inf,10,95\n", "line 2", "up to 1.2"),
    (HEAD + "2,inf,10,nan\n", "line 2", "light"),
    (HEAD + ROWS + "2,inf,10,0.7\n", "line 8", "each height of a curve once"),
    (HEAD + "2.8,inf,10,0.8\n2.8,inf,20,0.5\n", "curve at f/2.8", "2 heights: expected at least 3")])
def test_damaged_tables_are_refused_by_their_line(tmp_path, text, field, words):
    with refused(LensError, field=field, where="light.csv", match=words):
        read_vignetting(written(tmp_path, text))


def test_light_is_at_each_curves_own_heights():
    lens = prescription_of("helios-44-2-58mm")
    curves = [Vignetting(2.0, np.inf, np.array([5.0, 15.0]), np.ones(2)),
              Vignetting(2.0, np.inf, np.array([4.0, 15.0, 20.0]), np.ones(3)),
              Vignetting(8.0, 2000.0, np.array([15.0]), np.ones(1))]
    first, second, near = light_of(lens, curves)
    assert first[1] == second[1] and second[0] > first[0] > second[1] > second[2] and near[0] > first[1]
