"""Copies of a lens: the statistics of their displacements, which are rigid motions of elements and groups."""

from dataclasses import replace
from hashlib import blake2b

import numpy as np
import pytest

from lensfield.engine.library import bundled_lenses
from lensfield.engine.prescription.prescription import Pose
from lensfield.engine.prescription.tolerances import GRADES, Copy, as_built, elements
from lensfield.engine.runtime.errors import LensError
from mirror_lens import MIRROR_LENS
from refusals import refused

pytestmark = pytest.mark.one_blender
LENS = bundled_lenses()["tessar-50mm"]
SEEDS = range(1, 401)


def vertices_mm(lens):
    """The middles of surfaces: array (surface, 3)."""
    z_mm = np.cumsum([0.0, *(surface.thickness_mm for surface in lens.surfaces[:-1])])
    return np.array([(0, 0, z) + np.array((surface.pose or Pose()).offset_mm)
                     for z, surface in zip(z_mm, lens.surfaces, strict=True)])


def normals(lens):
    return np.array([(surface.pose or Pose()).rotation[:, 2] for surface in lens.surfaces])


def test_cemented_glasses_are_one_element():
    assert [list(element) for element in elements(LENS.surfaces)] == [[0, 1], [2, 3], [5, 6, 7]]
    assert LENS.stop_index == 4


def test_an_element_moves_rigidly_and_the_stop_stays():
    copy, before, after = as_built(LENS, Copy(3, "dropped")), vertices_mm(LENS), None
    after = vertices_mm(copy)
    assert copy.surfaces[4] == LENS.surfaces[4]
    for element in elements(LENS.surfaces):
        apart, apart_before = (np.diff(each[list(element)], axis=0) for each in (after, before))
        np.testing.assert_allclose(np.linalg.norm(apart, axis=1), np.linalg.norm(apart_before, axis=1), rtol=1e-9)
        axis = normals(copy)[list(element)]
        np.testing.assert_allclose(axis, axis[:1].repeat(len(element), 0), atol=1e-11)
        np.testing.assert_allclose(apart / np.linalg.norm(apart, axis=1, keepdims=True), axis[:-1], atol=1e-9)
    assert 0.03 < np.abs(after - before)[:, :2].max() < 2


@pytest.mark.parametrize("name", GRADES)
def test_displacements_have_the_grades_standard_deviations(name):
    """A group's tilt also moves an element's middle, by its distance from the group's."""
    grade, elements_of = GRADES[name], elements(LENS.surfaces)
    copies = [as_built(LENS, Copy(seed, name)) for seed in SEEDS]
    z_mm, moved = vertices_mm(LENS)[:, 2], np.array([vertices_mm(copy) for copy in copies])
    turned_arcmin = 60 * np.degrees(np.array([normals(copy) for copy in copies])[..., :2])
    for number, (element, group) in enumerate(zip(elements_of, ((0, 3), (0, 3), (5, 7)), strict=True)):
        first, last = element[0], element[-1]
        lever_mm = z_mm[[first, last]].mean() - z_mm[list(group)].mean()
        middle_um = 1e3 * moved[:, [first, last], :2].mean(axis=1)
        by_tilt_um = 1e3 * lever_mm * np.radians(grade.group_tilt_arcmin / 60)
        for values, variance in ((middle_um, grade.decentre_um**2 + grade.group_decentre_um**2 + by_tilt_um**2),
                                 (turned_arcmin[:, first], grade.tilt_arcmin**2 + grade.group_tilt_arcmin**2)):
            assert np.mean(values**2) / variance == pytest.approx(1, abs=5 * np.sqrt(2 / values.size)), number
            assert np.abs(values.mean(axis=0)).max() < 5 * np.sqrt(variance / len(values))
            assert abs(np.corrcoef(values.T)[0, 1]) < 5 / np.sqrt(len(values))


def test_a_copy_is_the_same_on_every_machine():
    """The first element's displacement along x, with the group's, by hand."""
    def normal(text):
        return sum(np.frombuffer(blake2b(text.encode(), digest_size=48).digest(), "<u4").astype(float)) / 2**32 - 6

    stiff = {name: replace(grade, tilt_arcmin=0.0, group_tilt_arcmin=0.0) for name, grade in GRADES.items()}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lensfield.engine.prescription.tolerances.GRADES", stiff)
        first, *_ = as_built(LENS, Copy(7, "vintage")).surfaces
    expected_um = 20 * (normal("7 element 1 x") + normal("7 group 0 x"))
    assert first.pose.offset_mm[0] == pytest.approx(expected_um * 1e-3, abs=1e-9) and abs(expected_um) > 1
    assert as_built(LENS, Copy(7, "vintage")) == as_built(LENS, Copy(7, "vintage"))
    assert as_built(LENS, Copy(7, "vintage")) != as_built(LENS, Copy(8, "vintage"))


def test_poses_of_the_design_are_moved_with_its_elements():
    first = replace(LENS.surfaces[0], pose=Pose((0.1, 0.0, 0.0), (0.0, 0.5, 0.0)))
    lens = replace(LENS, surfaces=(first, *LENS.surfaces[1:]))
    (posed, design), copy = (lens, LENS), Copy(5, "prime")
    moved = vertices_mm(as_built(posed, copy))[0] - vertices_mm(as_built(design, copy))[0]
    np.testing.assert_allclose(moved, (0.1, 0, 0), atol=1e-4)
    assert np.degrees(np.arccos(normals(as_built(posed, copy))[0] @ normals(as_built(design, copy))[0])
                      ) == pytest.approx(0.5, abs=1e-4)


@pytest.mark.parametrize("seed, grade, field", [(0, "prime", "seed"), (-1, "prime", "seed"), (3, "new", "grade")])
def test_an_invalid_copy_is_an_error(seed, grade, field):
    with refused(LensError, field=field, where="copy"):
        Copy(seed, grade)


def test_mirrors_move_as_elements():
    """Both passes through a mirror's glass move together, and a mirror without glass moves by itself."""
    assert [list(element) for element in elements(MIRROR_LENS.surfaces)] == [[0, 1], [3, 4, 5], [6], [7, 8]]
    built = as_built(MIRROR_LENS, Copy(3, "vintage")).surfaces
    assert built[3].pose == built[5].pose != built[4].pose and built[6].pose
