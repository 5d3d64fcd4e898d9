"""The plan of a scene: the minimal number of passes, its reasons, and its predictions against the picture."""

from functools import cache

import bpy
import numpy as np
import pytest

from lenses import make_lens
from lensfield import addon
from lensfield.addon.scene.errors import SceneError
from lensfield.engine import Options
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.spectral.colour_difference import ciede2000, lab_from_xyz
from lensfield.engine.spectral.spectra import colour_matching, emission_basis, load_spectrum, reflectance_basis
from lensfield.engine.spectral.wavelength_choice import STANDARD_COLOUR_ERROR, SpectralOptions
from noise import ROUNDING, surely_apart
from refusals import refused
from small_scenes import WAVELENGTHS_NM, light, material, paint_by_nodes, set_world, wall

NM = np.linspace(400, 700, 16)
FLAT, FLAT_DENSITY = "380:1, 780:1", 1 / 400
PATCHES = ["chart-13-blue", "chart-14-green", "chart-15-red", "chart-16-yellow", "chart-17-magenta", "chart-18-cyan"]
BLOCK_PX = 4  # large enough to remove most noise
SLACK = 1.25  # a picture's colours differ from the tested ones; noise moves its 95th percentile by some 2 %


@cache
def lens():
    return make_lens(wavelengths_nm=(380.0, 780.0))


def rendered(scene, folder, nm=NM, tier="standard", unfit="refuse", **limits):
    result = addon.render_through_lens(scene, lens=lens(), wavelengths_nm=nm, output_folder=folder,
                                       spectral=SpectralOptions(tier, **limits), unfit=unfit, depth="off",
                                       options=Options(detail="off"))
    return read_exr(result.radiance).frame().cube.astype(np.float64), result.report.as_dict()


def middle(picture):
    rows, columns = (n // 2 for n in picture.shape[1:])
    return picture[:, rows - 1:rows + 1, columns - 1:columns + 1].mean(axis=(1, 2))


def flat_world(scene, strength=1.0):
    set_world(scene, strength=strength)
    scene.world.lensfield.emission = FLAT


def painted(name, spectrum):
    new, _ = material(name, "ShaderNodeBsdfDiffuse")
    new.lensfield.reflectance = spectrum
    return new


def square(scene, of_material, location, rotation=(0, 0, 0), side_m=1.0):
    new = wall(scene, of_material, 0.0, side_m)
    new.location, new.rotation_euler = location, rotation
    return new


@pytest.fixture
def room(scene):
    """Coloured walls, a back wall of six patches and a textured ball, lit from the ceiling."""
    turn = np.pi / 2
    for name, location, rotation, spectrum in (
            ("Left", (-1, 0, -3), (0, turn, 0), "chart-15-red"), ("Right", (1, 0, -3), (0, -turn, 0), "chart-14-green"),
            ("Floor", (0, -1, -3), (-turn, 0, 0), "chart-12-orange-yellow"),
            ("Ceiling", (0, 1, -3), (turn, 0, 0), "chart-19-white")):
        square(scene, painted(name, spectrum), location, rotation, 2.0)
    for index, spectrum in enumerate(PATCHES):
        row, column = divmod(index, 3)
        square(scene, painted(spectrum, spectrum), ((column - 1) * 2 / 3, 0.5 - row, -4), side_m=1.0)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.3, location=(0.2, -0.5, -3))
    texture, link = paint_by_nodes("Texture", (0, 0, 0))
    noise = texture.node_tree.nodes.new("ShaderNodeTexNoise")
    texture.node_tree.links.new(noise.outputs["Color"], link.to_socket)
    bpy.context.object.data.materials.append(texture)
    lamp = light(scene, "AREA", 50.0, size=0.8)
    lamp.location = (0, 0.95, -3)
    scene.cycles.samples, scene.cycles.max_bounces = 64, 8
    scene.render.resolution_x, scene.render.resolution_y = 32, 24
    # No path ends at random and each pass takes all samples, so noise is the same at all wavelengths: it changes the
    # mix of colours, but adds no false ones.
    scene.cycles.min_light_bounces, scene.cycles.time_limit = 8, 1000.0
    return scene


def blocks(picture):
    planes, rows, columns = picture.shape
    cut = picture[:, :rows // BLOCK_PX * BLOCK_PX, :columns // BLOCK_PX * BLOCK_PX]
    return cut.reshape(planes, rows // BLOCK_PX, BLOCK_PX, columns // BLOCK_PX, BLOCK_PX).mean(axis=(2, 4))


def colour_errors(picture, truth, lamp):
    """CIEDE2000 of blocks, relative to a white as bright as the brightest block."""
    matching = colour_matching(NM)
    true, estimated = (np.moveaxis(blocks(cube), 0, -1).reshape(-1, NM.size) @ matching for cube in (truth, picture))
    white = lamp @ matching
    white *= true[:, 1].max() / white[1]
    return ciede2000(lab_from_xyz(true, white), lab_from_xyz(np.maximum(estimated, 0), white))


@pytest.mark.parametrize("lamp", ["illuminant-d65", "sodium-hp1"])
def test_standard_stays_within_its_predicted_error(room, tmp_path, lamp):
    bpy.data.lights["Light"].lensfield.emission = lamp
    picture, facts = rendered(room, tmp_path)
    truth, reference = rendered(room, tmp_path, tier="reference")
    assert facts["passes"] <= 4 and reference["passes"] == 6 and reference["predicted_colour_error"] == 0
    assert 0 < facts["predicted_colour_error"] <= STANDARD_COLOUR_ERROR
    errors = colour_errors(picture, truth, load_spectrum(lamp).band_means(NM))
    assert np.percentile(errors, 95) <= SLACK * facts["predicted_colour_error"]
    assert facts["spectral_surprise"] < 5


def test_two_lamps_stay_within_the_predicted_error(room, tmp_path):
    """Light of each lamp is estimated separately, and the errors may add up."""
    bpy.data.lights["Light"].lensfield.emission = "illuminant-a"
    light(room, "POINT", 10.0, shadow_soft_size=0.1).data.lensfield.emission = "sodium-lp"
    picture, facts = rendered(room, tmp_path)
    truth, _ = rendered(room, tmp_path, tier="reference")
    lamps = load_spectrum("illuminant-a").density_at(NM) + load_spectrum("sodium-lp").band_means(NM)
    errors = colour_errors(picture, truth, lamps)
    assert np.percentile(errors, 95) <= SLACK * facts["predicted_colour_error"]


def test_preview_is_one_pass_and_predicts_its_error(room, tmp_path):
    picture, facts = rendered(room, tmp_path, tier="preview")
    assert facts["passes"] == 1 and facts["predicted_colour_error"] > 1
    truth, _ = rendered(room, tmp_path, tier="reference")
    errors = colour_errors(picture, truth, load_spectrum("illuminant-d65").density_at(NM))
    assert 0.5 < np.percentile(errors, 95) <= SLACK * facts["predicted_colour_error"]


def test_a_lower_error_limit_gives_a_lower_error(room, tmp_path):
    truth, _ = rendered(room, tmp_path, tier="reference")
    lamp = load_spectrum("illuminant-d65").density_at(NM)
    results = []
    for limit in (3.0, 0.2):
        picture, facts = rendered(room, tmp_path, colour_error=limit)
        assert facts["predicted_colour_error"] <= limit
        results.append((facts["passes"], np.percentile(colour_errors(picture, truth, lamp), 95)))
        assert results[-1][1] <= limit
    assert results[0][0] < results[1][0] and results[0][1] > results[1][1]


def test_a_grey_scene_is_exact_at_all_wavelengths_in_one_pass(scene, tmp_path):
    set_world(scene, strength=0.5)
    scene.world.lensfield.emission = "illuminant-a"
    wall(scene, material("Grey", "ShaderNodeBsdfDiffuse", (0.4, 0.4, 0.4))[0])
    light(scene, "POINT", 10.0, shadow_soft_size=0.0).data.lensfield.emission = "sodium-lp"
    picture, facts = rendered(scene, tmp_path)
    assert facts["passes"] == 1 and len(facts["rendered_nm"]) == 1 and "grey" in facts["scene_plan"]
    expected = 0.4 * (0.5 * load_spectrum("illuminant-a").density_at(NM)
                      + 10 / (4 * np.pi**2) * load_spectrum("sodium-lp").band_means(NM))
    np.testing.assert_allclose(middle(picture), expected, rtol=1e-3)  # the cosines near the axis lose 1e-4


@pytest.mark.parametrize("tier", ["standard", "reference"])
def test_few_wavelengths_are_all_rendered(scene, tmp_path, tier):
    flat_world(scene)
    wall(scene, painted("Paint", "chart-15-red"))
    picture, facts = rendered(scene, tmp_path, WAVELENGTHS_NM, tier)
    assert facts["passes"] == 1 and facts["rendered_nm"] == facts["wavelengths_nm"] == list(WAVELENGTHS_NM)
    expected = load_spectrum("chart-15-red").at(WAVELENGTHS_NM) * FLAT_DENSITY
    np.testing.assert_allclose(middle(picture), expected, rtol=ROUNDING)


def test_the_report_includes_the_plan(room, tmp_path):
    _, facts = rendered(room, tmp_path)
    assert facts["wavelengths_nm"] == list(NM) and facts["wavelengths_per_pass"] == 3
    assert facts["passes"] == -(-len(facts["rendered_nm"]) // 3) > 1
    assert facts["lamps"] == ["daylight D65"] and 0 < facts["predicted_sensor_error"] < 0.1
    assert all(f"{nm:g}" in facts["scene_plan"] for nm in facts["rendered_nm"])


@pytest.mark.parametrize("colour, strength", [((1.0, 0.5, 0.1), 2.0), ((50.0, 25.0, 5.0), 0.04),
                                              ((2e-4, 1e-4, 2e-5), 1e4)])
def test_emission_strength_does_not_affect_the_choice_of_wavelengths(scene, tmp_path, colour, strength):
    glow, shader = material("Glow", "ShaderNodeEmission", colour)
    shader.inputs["Strength"].default_value = strength
    wall(scene, glow)
    picture, facts = rendered(scene, tmp_path)
    expected = emission_basis(NM) @ (2.0, 1.0, 0.2)
    matching = colour_matching(NM)
    white = load_spectrum("illuminant-d65").density_at(NM) @ matching * 2
    difference = ciede2000(*(lab_from_xyz(spectrum @ matching, white) for spectrum in (middle(picture), expected)))
    assert difference <= STANDARD_COLOUR_ERROR and 1 < len(facts["rendered_nm"]) <= 6


def test_unused_colours_cost_no_passes(scene, tmp_path):
    """Materials of hidden objects are substituted too, but light never reaches them."""
    flat_world(scene)
    wall(scene, material("Grey", "ShaderNodeBsdfDiffuse", (0.4, 0.4, 0.4))[0])
    unused = painted("Unused", "chart-15-red")
    unused.use_fake_user = True
    wall(scene, painted("Hidden", "chart-14-green"), 2.0).hide_render = True
    assert rendered(scene, tmp_path)[1]["passes"] == 1


def principled(name, **inputs):
    new = bpy.data.materials.new(name)
    new.use_nodes = True
    tree = new.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
    for socket, value in inputs.items():
        shader.inputs[socket.replace("_", " ")].default_value = value
    tree.links.new(shader.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return new


def tinted_ball(scene):
    tinted = principled("Tinted", Base_Color=(0.5, 0.5, 0.5, 1), IOR=2.5, Roughness=0.3,
                        Specular_Tint=(0.9, 0.3, 0.05, 1))
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.4, location=(0, 0, -1.5))
    bpy.ops.object.shade_smooth()
    bpy.context.object.data.materials.append(tinted)
    flat_world(scene)
    scene.cycles.samples = 32


@pytest.mark.every_blender
def test_a_coloured_specular_tint_is_rendered_one_wavelength_at_a_time(scene, tmp_path):
    tinted_ball(scene)
    together, facts = rendered(scene, tmp_path, WAVELENGTHS_NM, "reference")
    assert facts["passes"] == 3 and facts["wavelengths_per_pass"] == 1
    assert all(word in facts["scene_plan"] for word in ("Sphere", "'Tinted'", "Specular Tint"))
    for plane, nm in zip(together, WAVELENGTHS_NM, strict=True):
        alone, _ = rendered(scene, tmp_path, [nm])
        np.testing.assert_allclose(plane, alone[0], rtol=1e-5, atol=1e-8)


def test_rendering_tinted_wavelengths_together_would_be_wrong(scene, tmp_path, monkeypatch):
    """Otherwise the test above would prove nothing."""
    tinted_ball(scene)
    monkeypatch.setattr("lensfield.addon.capture.scene_plan.judge", lambda *_: ())
    together, facts = rendered(scene, tmp_path, WAVELENGTHS_NM, "reference")
    assert facts["passes"] == 1
    blue, _ = rendered(scene, tmp_path, WAVELENGTHS_NM[:1])
    assert together[0].mean() < blue[0].mean() and surely_apart(together[0], blue[0]) > 0.01 * blue[0].mean()


def test_separate_passes_take_no_more_wavelengths_than_needed(scene, tmp_path):
    tinted_ball(scene)
    _, facts = rendered(scene, tmp_path)
    assert facts["wavelengths_per_pass"] == 1 and facts["passes"] == len(facts["rendered_nm"]) <= 9


def film(scene):
    film = principled("Film", Thin_Film_Thickness=400.0)
    film.node_tree.nodes["Principled BSDF"].label = "Soap"
    wall(scene, film).name = "Bubble"
    flat_world(scene)


def test_unfit_nodes_are_refused_by_name(scene, tmp_path):
    film(scene)
    with pytest.raises(SceneError) as error:
        rendered(scene, tmp_path)
    message = str(error.value)
    assert all(word in message for word in ("Bubble", "'Film'", "Soap", "Thin Film Thickness", "rejected"))
    assert "\n" not in message and not list(tmp_path.iterdir())
    assert "unfit" in message  # the remedy


def test_unfit_nodes_are_rendered_on_request(scene, tmp_path):
    film(scene)
    picture, facts = rendered(scene, tmp_path, unfit="render")
    assert picture.mean() > 0.1 * FLAT_DENSITY and facts["passes"] >= 1


def test_unfit_nodes_of_hidden_objects_are_ignored(scene, tmp_path):
    film(scene)
    bpy.data.objects["Bubble"].hide_render = True
    np.testing.assert_allclose(rendered(scene, tmp_path)[0], FLAT_DENSITY, rtol=ROUNDING)


def test_an_unknown_value_of_unfit_is_refused(scene, tmp_path):
    with pytest.raises(InputError, match="unfit is ignore: expected refuse or render"):
        rendered(scene, tmp_path, unfit="ignore")


def test_keyframed_colours_follow_the_frame(scene, tmp_path):
    flat_world(scene)
    paint, shader = material("Paint", "ShaderNodeBsdfDiffuse")
    colour = shader.inputs["Color"]
    for frame, value in ((1, (0.5, 0.5, 0.5, 1)), (5, (0.7, 0.3, 0.05, 1))):
        colour.default_value = value
        colour.keyframe_insert("default_value", frame=frame)
    wall(scene, paint)
    pictures = {}
    for frame in (1, 5):
        scene.frame_set(frame)
        pictures[frame], facts = rendered(scene, tmp_path, WAVELENGTHS_NM)
        assert len(facts["rendered_nm"]) == (1 if frame == 1 else 3)
    np.testing.assert_allclose(middle(pictures[1]), 0.5 * FLAT_DENSITY, rtol=ROUNDING)
    expected = reflectance_basis(WAVELENGTHS_NM) @ (0.7, 0.3, 0.05) * FLAT_DENSITY
    np.testing.assert_allclose(middle(pictures[5]), expected, rtol=ROUNDING)


def test_keyframed_lumens_follow_the_frame(scene, tmp_path):
    lamp = light(scene, "POINT", 1.0, shadow_soft_size=0.0).data
    lamp.lensfield.emission, lamp.lensfield.power_unit = FLAT, "LUMEN"
    for frame, lumens in ((1, 100.0), (5, 400.0)):
        lamp.lensfield.lumens = lumens
        lamp.lensfield.keyframe_insert("lumens", frame=frame)
    wall(scene, material("White", "ShaderNodeBsdfDiffuse", (1, 1, 1))[0])
    scene.frame_set(1)
    dim = middle(rendered(scene, tmp_path, WAVELENGTHS_NM)[0])
    scene.frame_set(5)
    np.testing.assert_allclose(middle(rendered(scene, tmp_path, WAVELENGTHS_NM)[0]), 4 * dim, rtol=ROUNDING)


def test_driven_strength_is_followed(scene, tmp_path):
    glow, shader = material("Glow", "ShaderNodeEmission", (1, 1, 1))
    glow.lensfield.emission = FLAT
    driver = shader.inputs["Strength"].driver_add("default_value").driver
    driver.expression = "frame * 2"
    wall(scene, glow)
    scene.frame_set(3)
    np.testing.assert_allclose(middle(rendered(scene, tmp_path, WAVELENGTHS_NM)[0]), 6 * FLAT_DENSITY, rtol=ROUNDING)


def test_unused_inputs_of_a_default_principled_shader_have_no_colour(scene, tmp_path):
    """Its subsurface radius is (1, 0.2, 0.1), but its subsurface weight is 0."""
    flat_world(scene)
    wall(scene, principled("Grey", Base_Color=(0.5, 0.5, 0.5, 1), Roughness=1.0))
    _, facts = rendered(scene, tmp_path)
    assert facts["passes"] == 1 and facts["rendered_nm"] == [550] and "grey" in facts["scene_plan"]


def test_no_light_is_negative(room, tmp_path):
    picture, _ = rendered(room, tmp_path, np.linspace(400, 700, 31), colour_error=3)
    assert picture.min() >= 0


def test_a_background_set_is_refused(scene, tmp_path):
    scene.background_set = other = bpy.data.scenes.new("Set")
    with pytest.raises(SceneError, match=f"scene {scene.name!r}: background set is {other.name}: link its collections"):
        rendered(scene, tmp_path)


def test_an_error_in_an_unused_material_does_not_stop_a_render(scene, tmp_path):
    flat_world(scene)
    unused = painted("ChannelCache", "no-such-paint")
    unused.use_fake_user = True
    wall(scene, painted("Paint", "chart-20-neutral-8"))
    assert rendered(scene, tmp_path)[0].min() > 0


def test_spectra_of_linked_materials_are_relative_to_their_library(scene, tmp_path):
    flat_world(scene)
    (tmp_path / "library").mkdir()
    (tmp_path / "library" / "half.spd").write_text("380 0.5\n780 0.5\n")
    wall(scene, painted("Paint", "//half.spd"))
    bpy.data.libraries.write(str(tmp_path / "library" / "library.blend"), {bpy.data.objects["Wall"]})
    bpy.data.objects.remove(bpy.data.objects["Wall"])
    with bpy.data.libraries.load(str(tmp_path / "library" / "library.blend"), link=True) as (available, linked):
        linked.objects = available.objects
    scene.collection.objects.link(linked.objects[0])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "main.blend"))
    np.testing.assert_allclose(middle(rendered(bpy.context.scene, tmp_path)[0]), 0.5 * FLAT_DENSITY, rtol=ROUNDING)


def test_the_cameras_view_follows_the_frame(scene, tmp_path):
    flat_world(scene)
    for frame, focal_mm in ((1, 35.0), (10, 70.0)):
        scene.camera.data.lens = focal_mm
        scene.camera.data.keyframe_insert("lens", frame=frame)
    scene.frame_set(1)
    result = addon.render_through_lens(scene, lens=lens(), wavelengths_nm=[550], output_folder=tmp_path, view="camera",
                                       frame=10)
    times = f"scaled by {70 / lens().capture_focal_length_mm:.3g}"
    assert times in result.report.scene.lens_warning and scene.frame_current == 1


def test_glass_with_an_unknown_index_is_refused_before_rendering(scene, tmp_path):
    flat_world(scene)
    (tmp_path / "short.yml").write_text(
        "DATA:\n  - type: tabulated n\n    data: |\n      0.40 1.55\n      0.50 1.53\n      0.66 1.51\n")
    glass, _ = material("Glass", "ShaderNodeBsdfGlass")
    glass.lensfield.refraction = str(tmp_path / "short.yml")
    wall(scene, glass)
    with refused(SceneError, field="refraction", where="material 'Glass'", match="short.yml: .* 6[68]0 nm"):
        rendered(scene, tmp_path / "out")


def foreseen(scene, **options):
    return addon.preflight(scene, output_folder="out", **options).plan


def test_a_misspelt_spectrum_is_refused_but_the_plan_is_shown(room, tmp_path):
    room.lensfield.wavelength_count = 31
    known = foreseen(room)
    for name in ("chart-15-red", "chart-14-green"):
        bpy.data.materials[name].lensfield.reflectance = "no-such-paint"
    plan = foreseen(room)
    assert {error.where for error in plan.refusals} == {"material 'chart-15-red'", "material 'chart-14-green'"}
    assert "Cycles renders at" in plan.text
    assert plan.per_pass == 3 and not plan.apart and not known.refusals
    with refused(SceneError, field="reflectance spectrum", value="no-such-paint", where="material 'chart-14-green'"):
        rendered(room, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_plan_uses_the_default_for_a_misspelt_spectrum(scene):
    light(scene, "POINT", 10.0).data.lensfield.emission = "no-such-lamp"
    plan = foreseen(scene)
    assert [lamp.name for lamp in plan.lamps] == ["daylight D65"] and "no-such-lamp" in str(plan.refusals[0])


def test_unfit_nodes_are_refused_but_the_plan_is_shown(scene):
    film(scene)
    plan = foreseen(scene)
    refusal, = plan.refusals
    assert "Thin Film Thickness" in str(refusal) and "Cycles render" in plan.text
    assert not foreseen(scene, unfit="render").refusals
