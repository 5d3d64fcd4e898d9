"""Before a render: predicted refusals, and predicted differences from the scene."""

import json

import bpy
import pytest

from lensfield import addon, cli
from lensfield.addon import preflight
from lensfield.addon.capture.remarks import UNLAYERED
from lensfield.addon.render import preflight as before_a_render
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from small_scenes import adjust, light, material, set_world, wall
from snapshot import differences, snapshot

OF_DEPTH = {"Depth", *(what for what, *_ in UNLAYERED.values())}
"""Remarks that may be longer: they name a share of the picture, objects and a remedy."""


def short_index(tmp_path, letters):
    """A refractive index that is only defined from 400 to 600 nm, of a glass or a metal."""
    path = tmp_path / "short.yml"
    rows = "\n".join(f"      {um} {1.5 - um / 10}{' 3.0' * (letters == 'nk')}" for um in (0.4, 0.5, 0.6))
    path.write_text(f"DATA:\n  - type: tabulated {letters}\n    data: |\n{rows}\n")
    return str(path)


def painted(scene, node_type="ShaderNodeBsdfDiffuse"):
    paint, _ = material("Paint", node_type)
    wall(scene, paint)
    return paint


def refraction(letters, at_m=1.0):
    def change(scene, tmp_path):
        paint = painted(scene, "ShaderNodeBsdfGlass" if letters == "n" else "ShaderNodeBsdfGlossy")
        paint.lensfield.refraction = short_index(tmp_path, letters)
        scene.objects["Wall"].location.z = -at_m
    return change


def black_lumens(scene, tmp_path):
    data = light(scene, "POINT", 1.0, color=(0, 0, 0)).data
    data.lensfield.power_unit = "LUMEN"


def thin_film(scene, tmp_path):
    paint = bpy.data.materials.new("Film")
    paint.use_nodes = True
    shader = next(node for node in paint.node_tree.nodes if node.bl_idname == "ShaderNodeBsdfPrincipled")
    shader.inputs["Thin Film Thickness"].default_value = 400
    wall(scene, paint)


def film_as_it_comes(scene, tmp_path):
    thin_film(scene, tmp_path)
    scene.lensfield.unfit = "RENDER"


def grease_pencil(scene, tmp_path):
    data = getattr(bpy.data, "grease_pencils_v3", bpy.data.grease_pencils)
    scene.collection.objects.link(bpy.data.objects.new("Strokes", data.new("Strokes")))


def misspelt_world(scene, tmp_path):
    scene.world.lensfield.emission = "no-such-lamp"


def misspelt_but_unseen(scene, tmp_path):
    painted(scene).lensfield.reflectance = "no-such-paint"
    scene.objects["Wall"].hide_render = True


def second_layer(scene, tmp_path):
    scene.view_layers.new("Second")


def second_layer_chosen(scene, tmp_path):
    scene.view_layers.new("Second")
    scene.lensfield.view_layer = "Second"


def no_layer(scene, tmp_path):
    scene.view_layers[0].use = False


def background_set(scene, tmp_path):
    scene.background_set = bpy.data.scenes.new("Behind")


def marked_camera(scene, tmp_path):
    """A valid camera, but a marker switches to an orthographic one at frame 5."""
    other = bpy.data.objects.new("Other", bpy.data.cameras.new("Other"))
    other.data.type = "ORTHO"
    scene.collection.objects.link(other)
    scene.timeline_markers.new("Cut", frame=5).camera = other
    scene.frame_current = 5


def a_file_in_the_way(scene, tmp_path):
    (tmp_path / "taken").write_text("")
    scene.lensfield.output_folder = str(tmp_path / "taken" / "inside")


def a_folder_for_a_file(scene, tmp_path):
    (tmp_path / "out" / "unsaved_Scene_0001_lens_image.exr").mkdir(parents=True)


def linked_camera(scene, tmp_path):
    """Camera data shared with an object from another file, which cannot be replaced."""
    data = scene.camera.data
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {scene.camera}, fake_user=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, into):
        into.objects = ["Camera"]
    linked, = into.objects
    scene.collection.objects.link(linked)
    scene.camera = linked
    assert linked.data != data


def setting(owner, **values):
    def change(scene, tmp_path):
        target = owner(scene)
        for name, value in values.items():
            setattr(target, name, value)
    return change


def camera(**values):
    return setting(lambda scene: scene.camera.data, **values)


def lensfield(**values):
    return lambda scene, tmp_path: adjust(scene, **values)


SCENES = {
    "plain": lambda scene, tmp_path: None, "no camera": lambda scene, tmp_path: setattr(scene, "camera", None),
    "orthographic": camera(type="ORTHO"), "panorama": camera(type="PANO"), "shifted": camera(shift_x=0.1),
    "pixels": setting(lambda scene: scene.render, pixel_aspect_x=2.0),
    "one pixel": setting(lambda scene: scene.render, resolution_percentage=1), "clipped": camera(clip_start=2000.0),
    "flat camera": setting(lambda scene: scene.camera, scale=(1.0, 1.0, 0.0)),
    "fisheye by the camera": lambda scene, tmp_path: (
        camera(type="PANO", panorama_type="FISHEYE_LENS_POLYNOMIAL")(scene, tmp_path),
        lensfield(view="CAMERA")(scene, tmp_path)),
    "marked": marked_camera,
    "linked camera": linked_camera,
    "no lens": lensfield(lens="FILE", lens_file=""), "lost lens": lensfield(lens="FILE", lens_file="/nowhere.npz"),
    "wavelengths": lensfield(wavelength_mode="LIST", wavelength_list="blue"),
    "beyond the lens": lensfield(wavelength_last_nm=900.0), "no folder": lensfield(output_folder=""),
    "unsaved": lensfield(output_folder="//here"), "file in the way": a_file_in_the_way,
    "folder for a file": a_folder_for_a_file,
    "second layer": second_layer, "chosen layer": second_layer_chosen, "no layer": no_layer,
    "lost layer": lensfield(view_layer="Gone"), "set": background_set,
    "empty region": setting(lambda scene: scene.render, use_border=True, border_max_x=0.0),
    "film": thin_film, "film as it comes": film_as_it_comes, "strokes": grease_pencil, "lumens": black_lumens,
    "misspelt": misspelt_world, "misspelt unseen": misspelt_but_unseen, "glass": refraction("n"),
    "glass unseen": refraction("n", -1.0), "metal": refraction("nk"),
    "the camera's view": lensfield(view="CAMERA")}


@pytest.mark.sample(30)
@pytest.mark.parametrize("tier", ["preview", "standard", "reference"])
@pytest.mark.parametrize("name", SCENES)
def test_preflight_refuses_exactly_what_the_render_refuses(scene, tmp_path, name, tier):
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = 8, 6, 1
    set_world(scene)
    scene.lensfield.output_folder = str(tmp_path / "out")
    scene.lensfield.wavelength_count = 3
    scene.lensfield.depth = "AUTO" if tier == "standard" else "OFF"
    SCENES[name](scene, tmp_path)
    bpy.context.view_layer.update()
    before, files = snapshot(), sorted(tmp_path.rglob("*"))
    given = {"spectral": SpectralOptions(tier), "lens_quality": "preview"}
    result = preflight(scene, **given)
    changed = [line for line in differences(before, snapshot()) if "is_library_indirect" not in line]  # Blender sets it
    assert not changed and sorted(tmp_path.rglob("*")) == files
    try:
        addon.render_through_lens(scene, **given)
        refused = None
    except InputError as error:
        refused = str(error)
    assert bool(result.refusals) == bool(refused), (refused, result.refusals)
    if refused:
        assert refused.split(":")[0] in {str(refusal).split(":")[0] for refusal in result.refusals}


def test_all_refusals_are_reported_at_once(scene, tmp_path):
    black_lumens(scene, tmp_path)
    misspelt_world(scene, tmp_path)
    thin_film(scene, tmp_path)
    scene.lensfield.output_folder = ""
    result = preflight(scene)
    assert [refusal.field for refusal in result.refusals] == ["output folder", "emission spectrum", "color", "node"]
    assert result.plan and result.findings


def set_on(path, **values):
    def change(scene):
        owner = scene
        for name in path.split("."):
            owner = getattr(owner, name)
        for name, value in values.items():
            setattr(owner, name, value)
    return change


def with_a_strip(scene):
    scene.sequence_editor_create()
    scene.sequence_editor.strips.new_effect("Colour", "COLOR", channel=1, frame_start=1, **(
        {"length": 10} if bpy.app.version >= (5, 0, 0) else {"frame_end": 10}))


REMARKS = [
    (set_on("render", engine="BLENDER_WORKBENCH"), "standard", "Render Engine Workbench: Cycles renders instead"),
    (set_on("cycles", samples=4096), "standard", "Samples 4096: maximum per render; 256 with Denoise on"),
    (set_on("cycles", time_limit=60), "standard", "Time Limit 60 s: applies to each render"),
    (set_on("cycles", sample_clamp_indirect=10), "reference", "Clamp Indirect 10: ignored in Reference"),
    (set_on("cycles", use_denoising=True), "reference", "Denoise: ignored in Reference"),
    (set_on("camera.data.dof", use_dof=True), "standard", "Focus and F-Stop: f/2.8 is"),
    (set_on("camera.data", lens=100.0), "standard", "Focal Length 100 mm: the lens's view matches 56.2 mm"),
    (set_on("cycles", pixel_filter_type="GAUSSIAN"), "standard", "Pixel Filter 1.5 px: ignored"),
    (set_on("cycles", blur_glossy=5.0), "reference", None),
    (set_on("render", use_multiview=True), "standard", "Stereoscopy: ignored"),
    (set_on("render", use_border=True, use_crop_to_border=True), "standard", "Crop to Render Region: ignored"),
    (set_on("render", use_border=True), "standard", None),
    (set_on("render", use_freestyle=True), "standard", "Freestyle: ignored"),
    (with_a_strip, "standard", "Sequencer: ignored"),
    (set_on("cycles", sample_clamp_indirect=10), "standard", None),
    (set_on("cycles", use_denoising=True), "preview", None),
    (set_on("cycles", film_exposure=2.0), "reference", None),
    (set_on("render", use_motion_blur=True), "reference", None),
    (set_on("render", use_simplify=True), "reference", None)]


@pytest.mark.sample(6)
@pytest.mark.parametrize("change, tier, expected", REMARKS, ids=lambda value: value if isinstance(value, str) else "")
def test_only_settings_that_do_not_apply_are_reported_before_and_after(scene, tmp_path, change, tier, expected):
    scene.camera.data.lensfield.lens = "tessar-50mm"  # in focus to infinity
    assert bpy.ops.lensfield.match_camera() == {"FINISHED"}
    set_world(scene)
    change(scene)
    given = {"spectral": SpectralOptions(tier), "lens_quality": "preview"}
    predicted = [str(remark) for remark in preflight(scene, output_folder=tmp_path, **given).remarks]
    assert len(predicted) == (expected is not None) and all(remark.startswith(expected) for remark in predicted)
    if scene.cycles.samples < 1024:
        result = addon.render_through_lens(scene, output_folder=tmp_path, **given)
        assert [remark for remark in result.report.remarks() if remark in predicted] == predicted


def test_an_untouched_scene_gets_few_remarks(tmp_path):
    bpy.ops.wm.read_factory_settings()
    result = preflight(bpy.context.scene, output_folder=tmp_path)
    assert not result.refusals
    assert [remark.what for remark in result.remarks] == ["Render Engine", "Samples", "Depth"]
    assert all(len(str(remark)) < (200 if remark.what in OF_DEPTH else 130) for remark in result.remarks)


def test_the_lint_command_accepts_the_options_of_the_render(scene, tmp_path, capsys):
    set_world(scene)
    second_layer(scene, tmp_path)
    scene.lensfield.output_folder = ""
    blend = str(tmp_path / "scene.blend")
    bpy.ops.wm.save_as_mainfile(filepath=blend)
    assert cli.main(["lint", blend]) == 1
    assert capsys.readouterr().out.count("refused: ") == 2
    assert cli.main(["lint", blend, "--view-layer", "Second", "--output", str(tmp_path / "out")]) == 0
    assert not (tmp_path / "out").exists()
    assert cli.main(["lint", blend, "--view-layer", "Second", "--json"]) == 1
    report = json.loads(capsys.readouterr().out.split(f"output: {tmp_path / 'out'}\n", 1)[1])
    assert report["plan"].startswith("1 Cycles render at")
    assert [refusal["field"] for refusal in report["refusals"]] == ["output folder"]
    assert [remark["what"] for remark in report["remarks"]] == ["Focal Length"]


def test_preflight_of_a_traced_lens_does_not_examine_depth(scene, tmp_path, monkeypatch):
    def look(*_):
        pytest.fail("nothing is cut")

    for name in ("visible_depth_mm", "plan_by", "unlayered_remarks"):
        monkeypatch.setattr(before_a_render, name, look)
    set_world(scene)
    result = preflight(scene, output_folder=tmp_path, lens="tessar-50mm", depth="traced")
    assert result.plan and not result.refusals and result.slabs is None


@pytest.mark.parametrize("lens", ["edmund-54852", "muller-fisheye-25mm"])
def test_the_share_outside_the_depth_range_is_predicted(scene, tmp_path, lens):
    """The share of a near square in front of a far wall; a second square is hidden in renders."""
    near = wall(scene, material("Near", "ShaderNodeEmission")[0], 0.1, 0.05)
    near.location.x = 0.02
    wall(scene, material("Hidden", "ShaderNodeEmission")[0], 0.05).hide_render = True
    wall(scene, material("Far", "ShaderNodeEmission")[0], 5.0, 100.0)
    scene.camera.data.lensfield.lens = lens
    remarks = [str(remark) for remark in preflight(scene, output_folder=tmp_path, lens_quality="preview").remarks
               if remark.what == "Depth"]
    result = addon.render_through_lens(scene, output_folder=tmp_path, lens_quality="preview")
    exact = result.report.scene.depth.outside_fraction
    share = float(remarks[0].split("about ")[1].split("%")[0]) / 100 if remarks else 0.0
    assert 0.01 < exact and share == pytest.approx(exact, abs=0.06)  # a row of rays


def test_the_memory_of_many_masks_is_stated_before_the_render(scene):
    """40 objects of 4 bytes for each of 16 megapixels."""
    paint, _ = material("Paint", "ShaderNodeEmission")
    one = wall(scene, paint)
    for _ in range(39):
        scene.collection.objects.link(one.copy())
    scene.render.resolution_x, scene.render.resolution_y = 4000, 4000
    for truth, expected in (("coverage", True), ("collection-coverage", False), ("", False)):
        words = [str(remark) for remark in preflight(scene, lens="edmund-54852", truth=truth).remarks]
        assert any("the masks of 40 objects take up to 2.6 GB" in each for each in words) == expected
