"""Ground truth of renders, against the geometry of their scenes; and refusals before a render."""

import json
import math

import bpy
import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

import ground_truth
from laid_images import render_composite
from lensfield import addon, cli
from lensfield.addon.scene.compositor import compositing_tree
from lensfield.addon.scene.truth_outputs import INDICES
from lensfield.engine import InputError
from lensfield.engine.pictures.spectral_exr import read_parts
from lensfield.engine.truth.cryptomatte import id_of
from lensfield.request import TRUTH
from refusals import refused
from small_scenes import material, set_region, wall

QUICK = {"lens": "edmund-54852", "lens_quality": "preview", "wavelengths_nm": [550.0], "files": "pictures"}
STILL = ",".join(name for name in TRUTH if name != "flow" and not name.endswith("coverage"))


def render(scene, folder, **given):
    return addon.render_through_lens(scene, output_folder=folder, **QUICK | given)


def channels_of(result):
    (_, channels), = read_parts(result.truth)
    return {name.removeprefix("ViewLayer."): plane for name, plane in channels.items()}


@pytest.fixture
def painted(scene):
    """A wall of painted squares that leans away, and a small ball before it; the camera is off the origin."""
    scene.cycles.samples = 2
    scene.camera.location = 0.5, -0.25, 1.0
    paint, _ = material("Paint", "ShaderNodeEmission")
    paint.pass_index = 3
    leaning = wall(scene, paint, 0.5, 6.0)
    leaning.rotation_euler.y, leaning.pass_index = 0.6, 32767
    bpy.ops.mesh.primitive_ico_sphere_add(radius=0.05, location=(0.45, -0.2, 0.6))
    ball = bpy.context.object
    ball.name = "B\u00e4ll"
    ball.pass_index = 7
    ball.data.materials.append(material("Glow", "ShaderNodeEmission")[0])
    return scene


@pytest.mark.sample(2)
@pytest.mark.parametrize("figures", [ground_truth.board_figures, ground_truth.floor_figures, ground_truth.ball_figures,
                                     ground_truth.sky_figures, ground_truth.instance_figures],
                         ids=lambda figures: figures.__name__)
def test_truth_agrees_with_geometry(monkeypatch, figures):
    """A small version of `make validate-truth`: other numbers of pixels, and only one lens."""
    monkeypatch.setattr(ground_truth, "FRAME_PX", (60, 96))
    beyond = [(text, value) for text, value, limit in figures(ground_truth.Bench("edmund-54852"))
              if value > limit and "with another" not in text]  # more pixels of a smaller picture are at edges
    assert not beyond


def test_slabs_of_depth_and_motion_blur_do_not_change_the_truth(painted, tmp_path):
    """Slabs take a larger capture, whose pixels are the same ones."""
    fast = {"lens": "zeiss-biotar-50mm", "truth": STILL, "focus": 400.0, "f_number": 1.4}
    flat = channels_of(render(painted, tmp_path / "flat", depth="off", **fast))
    painted.render.use_motion_blur = True
    result = render(painted, tmp_path / "cut", **fast)
    assert result.report.scene.layers
    cut = channels_of(result)
    assert flat.keys() == cut.keys()
    for name in flat:
        if name.startswith("Crypto"):  # by random samples
            continue
        np.testing.assert_allclose(cut[name], flat[name], rtol=1e-4, atol=1e-4, err_msg=name)
        assert name in ("UV.A", "Normal.Y") or np.ptp(flat[name]), name


def test_truth_is_that_of_surfaces_in_fog(painted, tmp_path):
    clear = channels_of(render(painted, tmp_path, truth="depth,normal,index", depth="off"))
    fog, scatter = material("Fog", "ShaderNodeVolumeScatter")
    scatter.inputs["Density"].default_value = 20.0
    links = fog.node_tree.links
    links.new(scatter.outputs[0], links[0].to_node.inputs["Volume"])
    links.remove(links[0])
    bpy.ops.mesh.primitive_cube_add(size=0.1, location=(0.5, -0.25, 0.8))  # before the ball
    bpy.context.object.data.materials.append(fog)
    foggy = channels_of(render(painted, tmp_path, truth="depth,normal,index", depth="off"))
    for name, plane in clear.items():
        np.testing.assert_array_equal(foggy[name], plane, err_msg=name)


def test_cryptomatte_has_the_users_names(painted, tmp_path):
    result = render(painted, tmp_path, truth="cryptomatte")
    (header, channels), = read_parts(result.truth)
    manifests = {header[key.replace("manifest", "name")].removeprefix("ViewLayer."): json.loads(text)
                 for key, text in header.items() if key.endswith("/manifest")}
    assert manifests.keys() == {"CryptoObject", "CryptoMaterial", "CryptoAsset"}
    assert {"Wall", "B\u00e4ll"} == manifests["CryptoObject"].keys()
    assert {"Paint", "Glow"} <= manifests["CryptoMaterial"].keys()
    for kind, names in {"CryptoObject": ("Wall", "B\u00e4ll"), "CryptoMaterial": ("Paint", "Glow")}.items():
        shown = np.unique(channels[f"ViewLayer.{kind}00.r"])
        assert set(shown) - {0} == {id_of(name) for name in names}
    assert all(name.startswith("ViewLayer.Crypto") for name in channels)


@pytest.mark.parametrize("truth", ["object", "cryptomatte"])
def test_mattes_are_rendered_without_persistent_data(painted, tmp_path, truth):
    """After Cryptomatte with it, Blender 5.0 damages memory in later renders, and ends after a few frames."""
    painted.render.use_persistent_data = True
    states = []

    def note(scene, *_):
        states.append((scene.view_layers[0].use_pass_cryptomatte_object, scene.render.use_persistent_data))

    bpy.app.handlers.render_init.append(note)
    try:
        render(painted, tmp_path, truth=truth)
    finally:
        bpy.app.handlers.render_init.remove(note)
    assert set(states) == {(True, False), (False, True)} and painted.render.use_persistent_data


def test_a_decoder_reads_the_mattes(painted, tmp_path):
    cryptomatte_api = pytest.importorskip("cryptomatte_api", reason="cryptomatte-api is not installed")
    result = render(painted, tmp_path, truth="cryptomatte,index")
    mattes = {matte.metadata().name(): matte.masks() for matte in cryptomatte_api.Cryptomatte.load(str(result.truth))}
    masks = mattes["ViewLayer.CryptoObject"]
    index = next(plane for name, plane in channels_of(result).items() if name in ("Object Index.X", "IndexOB.X"))
    assert masks.keys() == {"Wall", "B\u00e4ll"}
    np.testing.assert_allclose(masks["Wall"] + masks["B\u00e4ll"], 1, atol=1e-6)
    around = sliding_window_view(masks["Wall"], (3, 3))
    even = np.ptp(around, axis=(2, 3)) == 0  # next to edges, all samples may miss what is in the pixel's middle
    assert np.array_equal(index[1:-1, 1:-1][even] == 32767, masks["Wall"][1:-1, 1:-1][even] == 1)
    assert set(np.unique(index[1:-1, 1:-1][even])) == {7, 32767}


def test_blenders_cryptomatte_node_picks_objects_by_name(painted, tmp_path):
    result = render(painted, tmp_path, truth="cryptomatte")
    node = bpy.data.node_groups.new("Mattes", "CompositorNodeTree").nodes.new("CompositorNodeCryptomatteV2")
    node.source, node.image = "IMAGE", bpy.data.images.load(str(result.truth))
    assert node.layer_name == "ViewLayer.CryptoObject"
    node.matte_id = "B\u00e4ll"
    assert [entry.encoded_hash for entry in node.entries] == [id_of("B\u00e4ll")]


def test_a_region_leaves_the_rest_empty(painted, tmp_path):
    set_region(painted, 0.25, 0.75, 0.25, 0.75)
    depth = channels_of(render(painted, tmp_path, truth="depth"))["Depth.Z"]
    inside = np.zeros(depth.shape, bool)
    inside[9:27, 12:36] = True
    assert np.array_equal(depth > 0, inside)


def test_the_file_is_written_on_request_and_removed_otherwise(painted, tmp_path):
    result = render(painted, tmp_path, truth="depth,normal", files="all")
    assert result.truth.is_file() and result.report.files["truth"] == str(result.truth)
    record = json.loads(result.record.read_text())
    assert record["job"]["truth"] == "depth,normal" and result.truth.name in record["sizes"]
    assert {name.partition(".")[0] for name in channels_of(result)} == {"Depth", "Distance", "Normal"}
    applied = addon.apply_lens(result.radiance, lens="tessar-50mm", lens_quality="preview")
    assert not applied.truth.exists(), "it shows what the other lens saw"
    assert "truth" not in json.loads(applied.record.read_text())["files"]
    assert render(painted, tmp_path, truth="uv").truth.is_file() and not render(painted, tmp_path).truth.exists()


def test_the_panel_and_the_command_choose_the_products(painted, tmp_path):
    painted.lensfield.truth = {"FLOW", "DEPTH"}
    assert painted.lensfield.to_request(lens="tessar-50mm").truth == "depth,flow"
    assert painted.lensfield.to_request(lens="tessar-50mm", truth="uv").truth == "uv"
    painted.lensfield.truth = {"UV"}
    path = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    command = ["render", path, "--lens", "edmund-54852", "--lens-quality", "preview", "--wavelengths", "550",
               "--files", "pictures", "--output", tmp_path / "out"]
    assert cli.main([str(word) for word in command]) == 0
    written, = (tmp_path / "out").glob("*_truth.exr")
    assert {name.partition(".")[2] for name in read_parts(written)[0][1]} == {"UV.U", "UV.V", "UV.A"}
    assert cli.main([*map(str, command), "--truth=normal", "--overwrite"]) == 0
    assert "ViewLayer.Normal.X" in read_parts(written)[0][1]


def test_the_compositors_node_shows_the_products(painted, tmp_path):
    """In a scene in inches, whose plain render has other passes than requested."""
    painted.unit_settings.scale_length = 0.0254
    result = render(painted, tmp_path, truth="position,index", to_compositor=True)
    node = compositing_tree(painted).nodes["Lensfield"]
    assert [socket.name for socket in node.outputs][-3:] == ["Position", *INDICES]
    for name, channel, unit in ((INDICES[1], "X", 1.0), ("Position", "X", 0.0254)):
        shown = composite_of(painted, node.outputs[name], tmp_path)
        np.testing.assert_allclose(shown * unit, channels_of(result)[f"{name}.{channel}"], rtol=1e-6)
        assert np.ptp(shown)


def composite_of(scene, socket, folder):
    tree = compositing_tree(scene)
    output = next(node for node in tree.nodes if node.bl_idname in ("NodeGroupOutput", "CompositorNodeComposite"))
    tree.links.new(socket, output.inputs[0])
    return render_composite(scene, folder / "composite.exr")[0]


def test_a_comparison_refuses_truth(painted, tmp_path):
    with refused(InputError, field="truth", value="depth", match="render through that lens"):
        addon.plan_comparison(painted, ["edmund-54852"], output_folder=tmp_path, truth="depth")


def test_a_preview_leaves_truth_to_renders(painted, tmp_path, capsys):
    with refused(InputError, field="truth", value="depth", match="a preview writes none: render the scene"):
        addon.open_preview(painted, truth="depth")
    painted.lensfield.truth = {"FLOW", "DEPTH"}
    painted.cycles.samples = 1
    path = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    words = [str(path), "--output", str(tmp_path), "--wavelengths", "550", "--lens", "edmund-54852"]
    assert cli.main(["preview", *words]) == 0
    assert "ground truth: depth,flow only in renders" in capsys.readouterr().out
    assert not list(tmp_path.glob("*_truth.exr"))
    assert cli.main(["compare", *words]) == 0
    assert "ground truth: depth,flow only in renders" in capsys.readouterr().out


@pytest.mark.parametrize("lens", ["edmund-54852", "pentax-fisheye-17mm"])
def test_the_background_moves_like_a_very_distant_surface(painted, tmp_path, lens):
    """Between two frames; the camera turns and moves, a marker binds another one to the next frame, and the axis is off
    the middle."""
    camera, rotation = painted.camera, (0.1, -0.2, 0.05)
    camera.data.shift_x, painted.unit_settings.scale_length = 0.1, 0.01
    other = bpy.data.objects.new("Other", camera.data)
    painted.collection.objects.link(other)
    for frame, bound in ((1, camera), (4, other)):
        painted.timeline_markers.new(bound.name, frame=frame).camera = bound
    for frame in (2, 3, 4, 5):
        camera.rotation_euler = [part * (frame - 2.9)**2 for part in rotation]
        camera.location.y = frame
        for path in ("rotation_euler", "location"):
            camera.keyframe_insert(path, frame=frame)
    painted.frame_set(3, subframe=0.25)
    empty = channels_of(render(painted, tmp_path, truth="flow", lens=lens))
    camera.data.clip_end = 1e8
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=6, radius=1e6)
    far = channels_of(render(painted, tmp_path, truth="flow", lens=lens))
    assert (painted.frame_current, painted.frame_subframe, painted.camera) == (3, 0.25, camera)
    for name, flow in empty.items():
        known = np.isfinite(flow)
        assert known.mean() > 0.9 and np.abs(flow[known]).max() > 1
        np.testing.assert_allclose(far[name][known], flow[known], atol=0.03, err_msg=name)  # its pixels are coarse


def test_the_background_of_a_camera_at_rest_does_not_move(painted, tmp_path):
    for frame, x in ((0, 0.0), (2, 1.0)):
        painted.objects["B\u00e4ll"].location.x = x
        painted.objects["B\u00e4ll"].keyframe_insert("location", frame=frame)
    bpy.data.objects.remove(painted.objects["Wall"])
    channels = channels_of(render(painted, tmp_path, truth="flow,index"))
    background = channels[f"{INDICES[0]}.X"] == 0
    assert background.any() and not background.all()
    for axis in "XYZW":
        assert not np.any(channels[f"Vector.{axis}"][background])
    assert np.any(channels["Vector.X"])


@pytest.mark.parametrize("truth, word", [("depths", "depths"), ("depth,,uv", "empty"), ("depth flow", "depth flow")])
def test_unknown_products_are_refused(painted, tmp_path, truth, word):
    with refused(InputError, field="truth", value=word, where="options", match="expected some of depth, position"):
        render(painted, tmp_path, truth=truth)


def test_truth_that_a_render_cannot_yield_is_refused_before_it(painted, tmp_path):
    with refused(InputError, field="truth", value="depth", match="leave truth out, or use depth auto or off"):
        render(painted, tmp_path, truth="depth", depth="traced")
    with refused(InputError, field="motion", value="none", where="scene 'Scene'",
                 match="animate an object or the camera, or leave flow out"):
        render(painted, tmp_path, truth="depth,flow")
    painted.camera.keyframe_insert("location", frame=0)
    painted.camera.location.x += 1
    painted.camera.keyframe_insert("location", frame=200)
    flow = channels_of(render(painted, tmp_path, truth="flow"))["Vector.X"]
    assert math.isfinite(flow.sum()) and np.abs(flow).max() > 0


def test_blenders_cryptomatte_node_reads_the_image_of_the_compositors_node(painted, tmp_path):
    result = render(painted, tmp_path, truth="cryptomatte", to_compositor=True)
    node = compositing_tree(painted).nodes.new("CompositorNodeCryptomatteV2")
    node.source, node.image = "IMAGE", bpy.data.images["Lensfield Scene Ground Truth"]
    node.frame_duration = 1
    node.matte_id = "B\u00e4ll"
    channels, matte = channels_of(result), composite_of(painted, node.outputs["Matte"], tmp_path)
    first, share, second, its_share = (channels[f"CryptoObject00.{channel}"] for channel in "rgba")
    ball = id_of("B\u00e4ll")
    expected = np.where(first == ball, share, 0) + np.where(second == ball, its_share, 0)
    np.testing.assert_allclose(matte, expected, atol=1e-6)
    assert np.ptp(matte) == 1
