"""Quick Look's node group, rendered by Blender's compositor, against the engine; and its place in the compositor."""

import bpy
import numpy as np
import pytest

from laid_images import lay, render_composite
from lenses import fine_grid_lens
from lensfield import addon
from lensfield.addon.scene.compositor import QUICK_LOOK, compositing_tree, scene_node
from lensfield.addon.scene.quick_look import MAP_X, MAP_Y, new_quick_look, set_lens
from lensfield.addon.ui.common.lens_at_rest import facts_at_rest
from lensfield.addon.ui.live.quick_look import compositor_lens, quick_look_question, read_look
from lensfield.engine import load_lens
from lensfield.engine.depth.depth_range import blur_per_nearness_px
from lensfield.engine.field.field_map import field_map
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens.entrance_pupil import focus_nearness
from lensfield.engine.lens.iris import Iris, opening
from lensfield.engine.lens.pinhole import fitting_pitch_um
from lensfield.engine.library.rays import lens_rays
from lensfield.engine.look.lens_tables import BOKEH_NODES, COLOURS_NM, lens_tables
from lensfield.engine.rays.rings import Rings
from small_scenes import set_world

SHAPE_PX = 1080, 1760
MOST_PX = 0.3 if bpy.app.version >= (5, 0, 0) else 1.0  # before, Displace filters anisotropically


def composited(scene, path, lens, picture, depth=None, iris=None, focus=0.0, shift_mm=(0.0, 0.0), aspect=1.0,
               **settings):
    """A picture through Quick Look: arrays (row, column, channel) with row 0 at the top."""
    group = new_quick_look()
    del group[QUICK_LOOK]  # so that it does not follow the scene's lens
    set_lens(group, compositor_lens(lens, lens.f_number_effective, iris, False, shift_mm, pixel_aspect=aspect),
             **settings)
    tree = compositing_tree(scene)
    tree.nodes.clear()
    node = tree.nodes.new("CompositorNodeGroup")
    node.node_tree = group
    node.inputs["Focus Distance"].default_value, node.inputs["F-Stop"].default_value = focus, lens.f_number_effective
    for socket, values in (("Image", picture), ("Depth", depth)):
        if values is not None:
            tree.links.new(image_node(tree, values).outputs["Image"], node.inputs[socket])
    has_groups = hasattr(scene, "compositing_node_group")
    output = tree.nodes.new("NodeGroupOutput" if has_groups else "CompositorNodeComposite")
    tree.links.new(node.outputs["Image"], output.inputs[0])
    scene.render.resolution_y, scene.render.resolution_x = picture.shape[:2]
    return np.moveaxis(render_composite(scene, path), 0, -1)


def image_node(tree, values):
    rows, columns, _ = values.shape
    image = bpy.data.images.new("Picture", columns, rows, float_buffer=True, is_data=True)
    image.pixels.foreach_set(np.dstack([values, np.ones((rows, columns))])[::-1].astype(np.float32).ravel())
    image.update()
    node = tree.nodes.new("CompositorNodeImage")
    node.image = image
    return node


def preview_lens(name):
    return anamorphic() if name == "hand-made grid" else load_lens(name, quality="preview", wavelengths_nm=COLOURS_NM)


def anamorphic(**changes):
    """A squeezed lens with barrel distortion across, lateral colour up and down, and a plane of focus that leans."""
    return fine_grid_lens(
        source_mm=lambda nm, x, y: (x * (1 + 0.02 * x**2), y * (1 + 5e-5 * (nm - 550))),
        relative_illumination=lambda nm, x, y: 1 - 0.02 * x**2 - 0.02 * y,
        **{"squeeze": 2.0, "wavelengths_nm": (400.0, 550.0, 700.0)} | changes)


def sources_px(lens, colour, shift_px, scale=1.0, aspect=1.0):
    """Rows and columns where the light of all pixels comes from, and their light, by the engine."""
    frame = PixelGrid(SHAPE_PX, fitting_pitch_um(lens, SHAPE_PX)).shifted(*shift_px)
    x_mm, y_mm = frame.axes_mm()
    field, pitch_mm = field_map(lens).at_wavelength(COLOURS_NM[colour]), frame.pitch_um * 1e-3
    light = field.relative_illumination(x_mm[None], y_mm[:, None])
    x_mm, y_mm = field.source_mm(x_mm[None], y_mm[:, None])
    row, column = frame.centre_px
    return row - scale * y_mm / pitch_mm, column + scale * lens.squeeze / aspect * x_mm / pitch_mm, light


@pytest.mark.parametrize(("name", "scale", "channels", "shift_px", "aspect"), [
    ("edmund-54852", 1.0, ("column", "row", "light"), (-80, 120), 1.0),
    ("muller-fisheye-25mm", 0.7, ("light", "column", "row"), (0, 0), 1.0),
    ("tessar-50mm", 1.3, ("row", "light", "column"), (300, -80), 1.0),
    ("hand-made grid", 0.9, ("row", "column", "light"), (30, -90), 2.0),
    ("hand-made grid", 0.8, ("column", "light", "row"), (0, 0), 1.6)])
def test_each_colour_is_where_the_lens_puts_it_and_as_bright(scene, tmp_path, name, scale, channels, shift_px, aspect):
    """Channels that hold their own row or column, or 1; the sensor is shifted to the right and up."""
    lens, (row, column) = preview_lens(name), np.indices(SHAPE_PX) + 10.0
    values = {"row": row, "column": column, "light": np.ones(SHAPE_PX)}
    shown = composited(scene, tmp_path / "picture.exr", lens, np.dstack([values[name] for name in channels]),
                       scale=scale, shift_mm=[px * fitting_pitch_um(lens, SHAPE_PX) * 1e-3 for px in shift_px],
                       aspect=aspect)
    *_, light = sources_px(lens, 1, shift_px)
    for colour, channel in enumerate(channels):
        row_px, column_px, _ = sources_px(lens, colour, shift_px, scale, aspect)
        inside = (abs(row_px - 539.5) < 538) & (abs(column_px - 879.5) < 878)
        outside = (abs(row_px - 539.5) > 541) | (abs(column_px - 879.5) > 881)
        assert inside.mean() > 0.5 and np.all(shown[outside, colour] == 0)
        place = shown[..., colour] / light
        if channel == "light":
            np.testing.assert_allclose(place[inside], 1, rtol=0.01)
        else:
            expected = {"row": row_px, "column": column_px}[channel] + 10
            assert abs(place - expected)[inside].max() < MOST_PX


def test_a_distant_point_is_blurred_like_the_lenss_rays(scene, tmp_path):
    """The opening of three blades, stopped down."""
    shape_px, focus_m, iris = (540, 880), 0.6, Iris(3, 20.0)
    lens = load_lens("tessar-50mm", Rings(None, 8.0), quality="preview", wavelengths_nm=COLOURS_NM)
    grid = PixelGrid(shape_px, fitting_pitch_um(lens, shape_px))
    picture = np.zeros((*shape_px, 3))
    picture[200, 650] = 1e4
    depth = np.full((*shape_px, 3), 1e10)
    light = composited(scene, tmp_path / "picture.exr", lens, picture, depth, iris, focus_m)[..., 1]
    tables = lens_tables(lens, lens_rays(lens, opening(iris, lens).reach), grid, iris)
    middle = BOKEH_NODES // 2, BOKEH_NODES // 2
    rays = tables.shifts[middle] @ (1, 1j) * -blur_per_nearness_px(lens, grid.pitch_um) / focus_m / 2e3
    row, column = np.indices(shape_px)
    disc = column - 1j * row
    moments = [_moments(*each) for each in ((disc, light), (rays, tables.light[middle]))]
    (size, shape), (expected_size, expected_shape) = moments
    assert size == pytest.approx(expected_size, rel=0.1)
    assert shape == pytest.approx(expected_shape, abs=0.05) and abs(expected_shape) > 0.2


def _moments(place, light):
    """Root mean square radius, and threefold symmetry."""
    place = place - np.average(place, weights=light)
    size = np.sqrt(np.average(abs(place)**2, weights=light))
    return size, np.average((place / size)**3, weights=light)


@pytest.fixture
def lit_scene(scene):
    set_world(scene, strength=1.0)
    scene.render.resolution_x, scene.render.resolution_y = 80, 40
    scene.cycles.samples = 1
    scene.camera.data.lens = 40  # wider than the lens: there is light beyond the frame
    return scene


def links(scene):
    return sorted((link.from_node.name, link.from_socket.name, link.to_node.name, link.to_socket.name)
                  for link in compositing_tree(scene).links)


def corner(scene, folder):
    """The relative light of the upper left pixel."""
    picture = render_composite(scene, folder / "picture.exr")[1]
    return picture[0, 0] / picture[20, 40]


def expected_corner(lens, right_px=0):
    frame = PixelGrid((40, 80), fitting_pitch_um(lens, (40, 80))).shifted(right_px, 0)
    light = field_map(lens).at_wavelength(COLOURS_NM[1]).relative_illumination(
        *frame.position_mm(np.array([0, 20]), np.array([0, 40])))
    return light[0] / light[1]


def test_the_node_follows_the_scenes_lens_in_background_renders(lit_scene, tmp_path):
    bpy.ops.lensfield.quick_look()
    node = scene_node(lit_scene, QUICK_LOOK)
    for name in ("tessar-50mm", "edmund-54852"):
        lit_scene.camera.data.lensfield.lens = name
        lit_scene.camera.data.lens = 36
        assert corner(lit_scene, tmp_path) == pytest.approx(expected_corner(preview_lens(name)), rel=0.01)
    assert node.label == "Quick Look: Edmund 54-852, 6 mm f/1.8"
    assert node.inputs["F-Stop"].default_value == pytest.approx(1.8, abs=0.05)
    lit_scene.camera.data.shift_x = 0.1
    assert corner(lit_scene, tmp_path) == pytest.approx(expected_corner(preview_lens(name), 8), rel=0.01)
    lit_scene.camera.data.type = "ORTHO"
    render_composite(lit_scene, tmp_path / "picture.exr")
    assert "type is ORTHO" in node.label, "the reason why it does not follow"


def test_the_file_shows_the_lens_without_the_addon(lit_scene, tmp_path):
    lit_scene.camera.data.lensfield.lens = "tessar-50mm"
    bpy.ops.lensfield.quick_look()
    before = corner(lit_scene, tmp_path)
    (tmp_path / "moved").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    (tmp_path / "scene.blend").rename(tmp_path / "moved" / "scene.blend")
    addon.unregister()
    try:
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "moved" / "scene.blend"))
        assert corner(bpy.context.scene, tmp_path) == pytest.approx(before, rel=1e-6) and before < 0.9
    finally:
        addon.register()


def test_it_takes_its_place_before_users_nodes_and_the_lens_image_and_gives_it_back(lit_scene, tmp_path):
    lit_scene.view_layers[0].use_pass_z = True
    tree = compositing_tree(lit_scene)
    tree.nodes.clear()
    output = tree.nodes.new("NodeGroupOutput" if hasattr(lit_scene, "compositing_node_group") else
                            "CompositorNodeComposite")
    layers, exposure = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeExposure")
    tree.links.new(layers.outputs["Image"], exposure.inputs[0])
    tree.links.new(exposure.outputs[0], output.inputs[0])
    before = links(lit_scene)
    bpy.ops.lensfield.quick_look()
    with_quick_look = links(lit_scene)
    assert ("Quick Look", "Image", "Exposure", "Image") in with_quick_look and len(with_quick_look) == 4
    bpy.ops.lensfield.quick_look()
    assert links(lit_scene) == with_quick_look
    lay(lit_scene, tmp_path, shape=(40, 80))
    assert {("Lensfield", "Image", "Exposure", "Image"), ("Quick Look", "Image", "Lensfield", "Image"),
            ("Render Layers", "Image", "Quick Look", "Image")} <= set(links(lit_scene))
    bpy.ops.lensfield.remove_from_compositor()
    assert links(lit_scene) == with_quick_look
    bpy.ops.lensfield.remove_quick_look()
    assert links(lit_scene) == before and not [image for image in bpy.data.images if image.packed_file]


def test_focus_and_f_stop_stay_as_the_user_sets_them(lit_scene, tmp_path):
    bpy.ops.lensfield.quick_look()
    node = scene_node(lit_scene, QUICK_LOOK)
    node.inputs["Focus Distance"].default_value = 3.0
    lit_scene.camera.data.lensfield.lens = "edmund-54852"
    bpy.ops.lensfield.quick_look()
    assert node.inputs["Focus Distance"].default_value == 3.0


def test_blenders_depth_of_field_is_not_repeated(lit_scene):
    dof = lit_scene.camera.data.dof
    dof.focus_distance, dof.aperture_fstop = 2.0, 8.0
    for dof.use_dof in (False, True):
        bpy.ops.lensfield.quick_look()
        node = scene_node(lit_scene, QUICK_LOOK)
        assert (node.node_tree.nodes["Blur"].outputs[0].default_value == 0) == dof.use_dof
    assert node.inputs["Focus Distance"].default_value == pytest.approx(2.0, rel=1e-3)
    assert node.inputs["F-Stop"].default_value == pytest.approx(8.0)


def test_a_copied_scene_gets_another_group(lit_scene):
    bpy.ops.lensfield.quick_look()
    bpy.ops.scene.new(type="FULL_COPY")
    other = bpy.context.scene
    other.camera.data.lensfield.lens = "edmund-54852"
    bpy.ops.lensfield.quick_look()
    first, second = (scene_node(scene, QUICK_LOOK) for scene in (lit_scene, other))
    assert first.node_tree != second.node_tree and "Edmund" in second.label and "Edmund" not in first.label


def test_a_scene_that_no_lens_can_replace_is_refused_and_unchanged(lit_scene):
    lit_scene.camera.data.type = "ORTHO"
    before = links(lit_scene)
    with pytest.raises(RuntimeError, match="type: ORTHO|type is ORTHO"):
        bpy.ops.lensfield.quick_look()
    assert links(lit_scene) == before and scene_node(lit_scene, QUICK_LOOK) is None


def test_an_anamorphic_lens_on_a_leaning_sensor_blurs_as_its_rays_do(scene, tmp_path):
    """Two points at the same depth, to the left and to the right; the plane of focus leans across."""
    shape_px, nearness, shapes = (1080, 1440), 1 / 117, []
    lens = anamorphic(focus_slope=(5e-5, 0.0), squeeze=1.3)
    grid, rays = PixelGrid(shape_px, fitting_pitch_um(lens, shape_px)), lens_rays(lens)
    picture, depth = np.zeros((*shape_px, 3)), np.full((*shape_px, 3), 1e-3 / nearness)
    picture[500, [240, 1240]] = 1e4
    sharp, light = (composited(scene, tmp_path / "picture.exr", lens, picture, each, focus=0.105, aspect=1.3)[..., 1]
                    for each in (None, depth))
    field, (row, column) = field_map(lens).at_wavelength(COLOURS_NM[1]), np.indices(shape_px)
    tables, per_nearness_px = lens_tables(lens, rays, grid), blur_per_nearness_px(lens, grid.pitch_um)
    for half in (np.s_[:, :720], np.s_[:, 720:]):
        _, sharp_px = _sizes(column[half], row[half], sharp[half])
        (right_px, down_px), sizes_px = _sizes(column[half], row[half], light[half])
        x_mm, y_mm = grid.position_mm(down_px, right_px)
        ideal_mm = field.source_mm(x_mm, y_mm)
        i, j = np.rint((BOKEH_NODES - 1) * np.array([1 - down_px / 1080, right_px / 1440])).astype(int)
        blur_px = per_nearness_px * (nearness - focus_nearness(lens, *ideal_mm))
        moved_px = tables.shifts[i, j] / (lens.squeeze, 1) * blur_px / 2
        _, expected_px = _sizes(*moved_px.T, tables.light[i, j])
        shapes.append((np.sqrt(np.square(sizes_px) - np.square(sharp_px)), expected_px))
    (left, expected_left), (right, expected_right) = shapes
    assert left == pytest.approx(expected_left, abs=0.3) and right == pytest.approx(expected_right, abs=0.3)
    assert left / right == pytest.approx(np.divide(expected_left, expected_right), rel=0.05)
    assert abs(expected_left[1] / expected_right[1] - 1) > 0.15 and expected_left[0] < 0.65 * expected_left[1]


def _sizes(x, y, light):
    """Centroid, and RMS width and height."""
    middle = [np.average(each, weights=light) for each in (x, y)]
    return middle, [np.sqrt(np.average((each - mean)**2, weights=light)) for each, mean in
                    zip((x, y), middle, strict=True)]


def test_the_sensor_is_turned_with_a_portrait_picture(lit_scene):
    lit_scene.camera.data.lensfield.lens, lit_scene.camera.data.lensfield.view = "tessar-50mm", "LENS"
    lit_scene.render.resolution_x, lit_scene.render.resolution_y = 400, 600
    look, *_ = read_look(*quick_look_question(lit_scene, facts_at_rest(lit_scene, None)))
    assert look.sensor[0] / look.sensor[1] == pytest.approx(2 / 3)


def test_a_lens_without_rotational_symmetry_takes_the_place_of_another_and_back(lit_scene, tmp_path):
    bpy.ops.lensfield.quick_look()
    node, symmetric = scene_node(lit_scene, QUICK_LOOK), corner(lit_scene, tmp_path)
    lit_scene.camera.data.lensfield.tilt_deg = 0.05, 0.0
    assert corner(lit_scene, tmp_path) != pytest.approx(symmetric, rel=1e-3)
    assert {MAP_X, MAP_Y} <= set(node.node_tree.nodes.keys())
    lit_scene.camera.data.lensfield.tilt_deg = 0.0, 0.0
    assert corner(lit_scene, tmp_path) == symmetric
    assert len([image for image in bpy.data.images if image.packed_file]) == 2, "the maps are removed"
