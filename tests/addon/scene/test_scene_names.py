"""Scenes of one file whose pictures would have the same file names."""

import pytest

from lensfield.addon.scene.errors import SceneError
from lensfield.addon.scene.requirements import check_scene


@pytest.mark.parametrize("name", ["Shot:1", "shot_1"])
def test_scenes_do_not_share_the_names_of_their_files(scene, name):
    other = scene.copy()
    scene.name, other.name = "Shot_1", name
    for each in (scene, other):
        with pytest.raises(SceneError, match="name is like that of scene .* in file names: rename one of the scenes"):
            check_scene(each)
    check_scene(scene, output_folder="elsewhere")
    other.lensfield.output_folder = "//other/"
    check_scene(scene)


def test_scenes_with_other_names_share_a_folder(scene):
    scene.copy().name = "Shot_2"
    scene.name = "Shot_1"
    check_scene(scene)
