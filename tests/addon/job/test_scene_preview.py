"""The preview of a loaded scene, without a window: the same lens as in a render."""

import numpy as np
import OpenEXR

from lensfield import addon
from small_scenes import material, set_world, wall


def last_picture(scene, folder, **given):
    """R, G and B of the last picture of a scene's preview."""
    preview, shown = addon.open_preview(scene, lens="zeiss-biotar-50mm", view="camera", lens_quality="preview",
                                        wavelengths_nm=(550.0,), output_folder=folder, **given), []
    preview.run(shown.append, lambda fraction, label: None)
    preview.close()
    with OpenEXR.File(shown[-1]["picture"], separate_channels=True) as file:
        return np.stack([file.parts[0].channels[name].pixels for name in "RGB"])


def test_the_lens_follows_the_depth_of_field_of_the_camera(scene, tmp_path):
    set_world(scene)
    wall(scene, material("Grey", "ShaderNodeBsdfDiffuse", (0.5, 0.5, 0.5))[0], side_m=0.3)
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = 8, 6, 1
    dof = scene.camera.data.dof
    dof.use_dof, dof.aperture_fstop, dof.focus_distance = True, 5.6, 2.0
    by_camera, stated, wide_open = (last_picture(scene, tmp_path / name, **given) for name, given in (
        ("camera", {}), ("stated", {"f_number": 5.6, "focus": 2000.0}), ("open", {"f_number": 1.4, "focus": 2000.0})))
    np.testing.assert_array_equal(by_camera, stated)
    assert np.abs(by_camera - wide_open).max() > 0.05 * wide_open.max()
