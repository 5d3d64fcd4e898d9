"""The linter: each verdict on a scene built by hand, and measurements of the biases that it reports."""

import json
import os
import re

import bpy
import numpy as np
import pytest

from cycles_pictures import picture
from lensfield import addon, cli
from lensfield.addon.shading import closure_rules, node_rules
from lensfield.addon.shading.lint import Finding, lint
from lensfield.addon.shading.node_paths import constant_of
from lensfield.addon.shading.node_rules import APPROXIMATED, REJECTED, SEPARATED, SUBSTITUTED, UPSAMPLED, VERDICTS
from lensfield.addon.ui import lint_panel
from lensfield.addon.ui.common.session import session
from lensfield.engine.spectral.spectra import (
    BAND_NM,
    blackbody,
    channel_basis,
    colour_matching,
    emission_basis,
    reflectance_basis,
)
from noise import ROUNDING, assert_means, surely_apart
from places import SAMPLE_SCENE
from small_scenes import background, light, material, set_world, wall

XYZ_TO_REC709 = np.linalg.inv([[0.4123908, 0.3575843, 0.1804808], [0.2126390, 0.7151687, 0.0721923],
                               [0.0193308, 0.1191948, 0.9505322]])  # IEC 61966-2-1


def painted(scene, node_type, name="Paint"):
    """A wall whose material is one shader node; returns the node."""
    new = bpy.data.materials.new(name)
    new.use_nodes = True
    new.node_tree.nodes.clear()
    shader = new.node_tree.nodes.new(node_type)
    output = new.node_tree.nodes.new("ShaderNodeOutputMaterial")
    if shader.outputs:
        volume = shader.outputs[0].name == "Volume"
        new.node_tree.links.new(shader.outputs[0], output.inputs["Volume" if volume else "Surface"])
    wall(scene, new)
    return shader


def fed(shader, socket, node_type, output=0):
    """A new node linked to a socket; returns it."""
    tree = shader.id_data
    node = tree.nodes.new(node_type)
    tree.links.new(node.outputs[output], shader.inputs[socket])
    return node


def verdicts_in(scene, block_type="material"):
    """{(node, socket): verdict} of the remarks on the data-blocks of a type."""
    return {(finding.node, finding.socket): finding.verdict for finding in lint(scene)
            if finding.block_type == block_type}


def test_every_shader_node_of_this_blender_is_known():
    """A node of a new Blender is rejected until Cycles' treatment of it has been examined."""
    known = [node_rules.COLOURS, node_rules.ARITHMETIC, set(node_rules.SPECIAL), node_rules.FLOW, node_rules.STRUCTURE,
             closure_rules.CLOSURES, closure_rules.NOT_IN_CYCLES]
    assert sum(map(len, known)) == len(set.union(*known)), "a node has two rules"
    tree = bpy.data.materials.new("Any").node_tree or bpy.data.node_groups.new("Any", "ShaderNodeTree")
    types = {name for name in dir(bpy.types) if issubclass_of_node(name) and fits(tree, name)}
    assert len(types) > 90
    assert types <= set.union(*known), sorted(types - set.union(*known))


def issubclass_of_node(name):
    kind = getattr(bpy.types, name)
    return isinstance(kind, type) and issubclass(kind, bpy.types.Node)


def fits(tree, node_type):
    try:
        tree.nodes.remove(tree.nodes.new(node_type))
    except RuntimeError:  # a node for other trees, or a base class
        return False
    return True


def test_every_closure_rule_applies_to_a_closure(scene):
    tree = painted(scene, "ShaderNodeEmission").id_data
    for node_type in closure_rules.CLOSURES | closure_rules.NOT_IN_CYCLES:
        if hasattr(bpy.types, node_type) and fits(tree, node_type):
            assert any(output.type == "SHADER" for output in tree.nodes.new(node_type).outputs), node_type
    for node_type in node_rules.COLOURS | node_rules.ARITHMETIC:
        if hasattr(bpy.types, node_type) and fits(tree, node_type):
            assert not any(output.type == "SHADER" for output in tree.nodes.new(node_type).outputs), node_type


def test_a_finding_is_one_line_that_starts_with_the_object():
    finding = Finding(("Pawn.003", "Pawn.004", "Rook"), "material", "Glass", "Group > Principled BSDF",
                      "Thin Film Thickness", REJECTED, "why")
    assert str(finding) == ("Pawn.003 (and 2 more): material 'Glass' > Group > Principled BSDF > Thin Film Thickness: "
                            "rejected: why")


@pytest.mark.parametrize("node_type, socket, output, verdict", [
    ("ShaderNodeRGB", "Color", 0, UPSAMPLED), ("ShaderNodeTexImage", "Color", 0, UPSAMPLED),
    ("ShaderNodeHueSaturation", "Color", 0, UPSAMPLED), ("ShaderNodeValToRGB", "Color", 0, UPSAMPLED),
    ("ShaderNodeVertexColor", "Color", 0, UPSAMPLED), ("ShaderNodeAttribute", "Color", 0, UPSAMPLED),
    ("ShaderNodeRGBToBW", "Color", 0, UPSAMPLED), ("ShaderNodeLightPath", "Color", 0, UPSAMPLED),
    ("ShaderNodeAmbientOcclusion", "Color", 0, UPSAMPLED), ("ShaderNodeBevel", "Color", 0, UPSAMPLED),
    ("ShaderNodeMix", "Color", 2, UPSAMPLED), ("ShaderNodeBlackbody", "Color", 0, APPROXIMATED),
    ("ShaderNodeTexSky", "Color", 0, APPROXIMATED), ("ShaderNodeWavelength", "Color", 0, APPROXIMATED),
    ("ShaderNodeShaderToRGB", "Color", 0, REJECTED)])
def test_nodes_linked_to_a_shader_get_a_verdict(scene, node_type, socket, output, verdict):
    shader = painted(scene, "ShaderNodeBsdfDiffuse")
    node = fed(shader, socket, node_type, output)
    assert verdicts_in(scene)[node.name, node.outputs[output].name] == verdict
    assert verdicts_in(scene)[shader.name, ""] == UPSAMPLED


@pytest.mark.parametrize("space, verdict", [("sRGB", UPSAMPLED), ("Linear Rec.709", UPSAMPLED),
                                            ("Non-Color", APPROXIMATED), ("ACEScg", APPROXIMATED)])
def test_an_image_is_checked_by_its_colour_space(scene, space, verdict):
    node = fed(painted(scene, "ShaderNodeBsdfDiffuse"), "Color", "ShaderNodeTexImage")
    node.image = bpy.data.images.new("Picture", 4, 4)
    node.image.colorspace_settings.name = space
    assert verdicts_in(scene)["Image Texture", "Color"] == verdict


def test_upstream_nodes_are_checked_except_for_numbers(scene):
    shader = painted(scene, "ShaderNodeBsdfPrincipled")
    mix = fed(shader, "Base Color", "ShaderNodeMixRGB")
    fed(mix, "Color2", "ShaderNodeWavelength")
    fed(mix, "Fac", "ShaderNodeBlackbody")
    fed(shader, "Roughness", "ShaderNodeTexSky")
    tree = shader.id_data
    output = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputMaterial")
    fed(output, "Displacement", "ShaderNodeShaderToRGB")
    tree.nodes.new("ShaderNodeEeveeSpecular")
    assert verdicts_in(scene) == {(shader.name, ""): SUBSTITUTED, (mix.name, "Color"): UPSAMPLED,
                                  ("Wavelength", "Color"): APPROXIMATED}


@pytest.mark.parametrize("node_type", sorted(closure_rules.CLOSURES - {"ShaderNodeBsdfGlossy", "ShaderNodeBsdfVelvet"}))
def test_shaders_with_default_settings_are_substituted(scene, node_type):
    if not hasattr(bpy.types, node_type):
        pytest.skip("this Blender has no such node")
    shader = painted(scene, node_type)
    verdicts = verdicts_in(scene)
    assert verdicts[shader.name, ""] == SUBSTITUTED
    # Scattering lengths differ for red, green and blue by default.
    assert set(verdicts.values()) <= {SUBSTITUTED, APPROXIMATED} and (len(verdicts) == 1 or "Subsurface" in node_type)


@pytest.mark.parametrize("node_type, changes, socket, verdict", [
    ("ShaderNodeBsdfPrincipled", {"Thin Film Thickness": 400.0}, "Thin Film Thickness", REJECTED),
    ("ShaderNodeBsdfPrincipled", {"Specular Tint": (1, 0.5, 0.2, 1)}, "Specular Tint", SEPARATED),
    ("ShaderNodeBsdfPrincipled", {"Specular Tint": (0.5, 0.5, 0.5, 1)}, "Specular Tint", None),
    ("ShaderNodeBsdfPrincipled", {"Specular Tint": (1, 0.5, 0.2, 1), "Metallic": 1.0}, "Specular Tint", None),
    ("ShaderNodeBsdfPrincipled", {"Specular Tint": (1, 0.5, 0.2, 1), "Specular IOR Level": 0.0}, "Specular Tint", None),
    ("ShaderNodeBsdfPrincipled", {"Sheen Tint": (1, 0.5, 0.2, 1), "Sheen Weight": 0.5}, "Sheen Tint", SEPARATED),
    ("ShaderNodeBsdfPrincipled", {"Sheen Tint": (1, 0.5, 0.2, 1), "Sheen Weight": 0.0}, "Sheen Tint", None),
    ("ShaderNodeBsdfPrincipled", {"Sheen Tint": (1, 1, 1, 1), "Sheen Weight": 0.5}, "Sheen Tint", None),
    ("ShaderNodeBsdfPrincipled", {"Subsurface Weight": 0.5}, "Subsurface Radius", APPROXIMATED),
    ("ShaderNodeBsdfPrincipled", {"Subsurface Weight": 0.5, "Subsurface Radius": (1, 1, 1)}, "Subsurface Radius", None),
    ("ShaderNodeVolumePrincipled", {"Blackbody Intensity": 1.0}, "Blackbody Intensity", REJECTED),
    ("ShaderNodeVolumePrincipled", {"Color Attribute": "color"}, "Color Attribute", REJECTED)])
def test_settings_that_cycles_renders_in_rgb_are_reported(scene, node_type, changes, socket, verdict):
    shader = painted(scene, node_type)
    for name, value in changes.items():
        shader.inputs[name].default_value = value
    assert verdicts_in(scene).get((shader.name, socket)) == verdict


@pytest.mark.parametrize("socket, verdict", [("Specular Tint", SEPARATED), ("Thin Film Thickness", REJECTED)])
def test_values_computed_by_nodes_are_assumed_to_vary(scene, socket, verdict):
    shader = painted(scene, "ShaderNodeBsdfPrincipled")
    fed(shader, socket, "ShaderNodeTexNoise")
    assert verdicts_in(scene)[shader.name, socket] == verdict


def test_a_thickness_of_zero_from_a_node_is_accepted(scene):
    shader = painted(scene, "ShaderNodeBsdfPrincipled")
    value = fed(shader, "Thin Film Thickness", "ShaderNodeValue")
    value.outputs[0].default_value = 0
    assert REJECTED not in verdicts_in(scene).values()
    value.outputs[0].default_value = 300
    assert verdicts_in(scene)[shader.name, "Thin Film Thickness"] == REJECTED


def test_melanin_is_rejected_and_a_hair_colour_is_not(scene):
    shader = painted(scene, "ShaderNodeBsdfHairPrincipled")
    shader.parametrization = "MELANIN"
    assert verdicts_in(scene)[shader.name, "Melanin"] == REJECTED
    shader.parametrization = "COLOR"
    assert set(verdicts_in(scene).values()) == {SUBSTITUTED}


def test_a_shader_that_cycles_does_not_support_is_rejected(scene, tmp_path):
    shader = painted(scene, "ShaderNodeEeveeSpecular")
    assert verdicts_in(scene) == {(shader.name, ""): REJECTED}
    set_world(scene)
    assert picture(scene, tmp_path).max() == 0


def test_a_node_of_another_add_on_is_rejected_as_unknown(scene):
    class Other(bpy.types.ShaderNodeCustomGroup):
        bl_idname, bl_label = "ShaderNodeOfAnotherAddOn", "Other"

    bpy.utils.register_class(Other)
    try:
        shader = painted(scene, "ShaderNodeBsdfDiffuse")
        tree = bpy.data.node_groups.new("Inside", "ShaderNodeTree")
        tree.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
        node = shader.id_data.nodes.new(Other.bl_idname)
        node.node_tree = tree
        shader.id_data.links.new(node.outputs[0], shader.inputs["Color"])
        finding = lint(scene)[0]
        assert finding.verdict == REJECTED and finding.node == node.name and "unknown" in finding.text
    finally:
        bpy.utils.unregister_class(Other)


def test_nodes_in_groups_are_checked_and_named(scene):
    mixer = painted(scene, "ShaderNodeMixShader")
    inner = bpy.data.node_groups.new("Coat", "ShaderNodeTree")
    inner.interface.new_socket("Colour", in_out="INPUT", socket_type="NodeSocketColor")
    inner.interface.new_socket("Other", in_out="INPUT", socket_type="NodeSocketColor")
    inner.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    shader = inner.nodes.new("ShaderNodeBsdfDiffuse")
    inner.links.new(inner.nodes.new("NodeGroupInput").outputs[0], shader.inputs["Color"])
    inner.links.new(shader.outputs[0], inner.nodes.new("NodeGroupOutput").inputs[0])
    labelled, sky = (mixer.id_data.nodes.new("ShaderNodeGroup") for _ in range(2))
    for index, (group, label) in enumerate(((labelled, "Plain"), (sky, "")), start=1):
        group.node_tree, group.label = inner, label
        mixer.id_data.links.new(group.outputs[0], mixer.inputs[index])
    fed(sky, "Colour", "ShaderNodeTexSky")
    fed(sky, "Other", "ShaderNodeWavelength")  # leads nowhere
    assert verdicts_in(scene) == {("Mix Shader", ""): SUBSTITUTED, ("Plain > Diffuse BSDF", ""): SUBSTITUTED,
                                  ("Coat > Diffuse BSDF", ""): UPSAMPLED, ("Sky Texture", "Color"): APPROXIMATED}


def test_a_group_without_an_output_is_black_and_rejected(scene, tmp_path):
    shader = painted(scene, "ShaderNodeEmission")
    tree = bpy.data.node_groups.new("Hollow", "ShaderNodeTree")
    tree.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    node = shader.id_data.nodes.new("ShaderNodeGroup")
    node.node_tree = tree
    shader.id_data.links.new(node.outputs[0], shader.inputs["Color"])
    assert verdicts_in(scene)["Group", ""] == REJECTED
    assert picture(scene, tmp_path).max() == 0


def loose_reroute(tree):
    return tree.nodes.new("NodeReroute").outputs[0]


def muted_colour(tree):
    return muted(tree, "ShaderNodeRGB")


def muted_change(tree):
    return muted(tree, "ShaderNodeHueSaturation")


def muted_change_of_a_colour(tree):
    output = muted(tree, "ShaderNodeHueSaturation")
    colour = tree.nodes.new("ShaderNodeRGB")
    colour.outputs[0].default_value = (0.7, 0.5, 0.3, 1)
    tree.links.new(colour.outputs[0], output.node.inputs["Color"])
    return output


def muted(tree, node_type):
    node = tree.nodes.new(node_type)
    node.mute = True
    return node.outputs[0]


@pytest.mark.parametrize("source", [loose_reroute, muted_colour, muted_change, muted_change_of_a_colour],
                         ids=lambda source: source.__name__)
def test_loose_and_muted_inputs_have_the_colour_that_cycles_renders(scene, tmp_path, source):
    if bpy.app.version < (5, 0, 0) and source in (loose_reroute, muted_change):
        pytest.skip("before 5.0 Cycles rendered black what hangs loose")
    shader = painted(scene, "ShaderNodeEmission")
    shader.inputs["Color"].default_value = (0.1, 0.2, 0.3, 1)
    shader.id_data.links.new(source(shader.id_data), shader.inputs["Color"])
    expected = constant_of(shader.inputs["Color"])[:3]
    np.testing.assert_allclose(picture(scene, tmp_path).mean(axis=(1, 2)), expected, rtol=1e-5)


def test_bundles_and_switches_are_followed(scene):
    if not hasattr(bpy.types, "NodeCombineBundle"):
        pytest.skip("this Blender has no bundles of shaders")
    shader = painted(scene, "ShaderNodeEmission")
    tree = shader.id_data
    output = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputMaterial")
    pack, unpack = tree.nodes.new("NodeCombineBundle"), tree.nodes.new("NodeSeparateBundle")
    for node in (pack, unpack):
        node.bundle_items.new("SHADER", "glow")
    tree.links.new(shader.outputs[0], pack.inputs[0])
    tree.links.new(pack.outputs[0], unpack.inputs[0])
    tree.links.new(unpack.outputs[0], output.inputs["Surface"])
    switch = fed(shader, "Color", "GeometryNodeMenuSwitch")
    switch.data_type = "RGBA"
    tree.links.new(switch.outputs[0], shader.inputs["Color"])
    fed(switch, 1, "ShaderNodeWavelength")
    assert verdicts_in(scene) == {("Emission", ""): UPSAMPLED, ("Wavelength", "Color"): APPROXIMATED}


def test_an_assigned_spectrum_replaces_nodes(scene):
    shader = painted(scene, "ShaderNodeBsdfPrincipled")
    fed(shader, "Base Color", "ShaderNodeTexSky")
    shader.inputs["Emission Strength"].default_value = 1
    fed(shader, "Emission Color", "ShaderNodeWavelength")
    paint = bpy.data.materials["Paint"].lensfield
    paint.reflectance = "chart-15-red"
    assert verdicts_in(scene) == {(shader.name, ""): SUBSTITUTED, ("Wavelength", "Color"): APPROXIMATED}
    paint.emission = "illuminant-a"
    assert verdicts_in(scene) == {(shader.name, ""): SUBSTITUTED}


def test_an_unreadable_spectrum_is_rejected(scene):
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse")[0])
    bpy.data.materials["Paint"].lensfield.reflectance = "no-such-paint"
    finding = lint(scene)[0]
    assert finding.verdict == REJECTED and finding.object_names == ("Wall",) and "no-such-paint" in str(finding)


def test_a_constant_blackbody_follows_plancks_law(scene):
    shader = painted(scene, "ShaderNodeEmission")
    thermal = fed(shader, "Color", "ShaderNodeBlackbody")
    assert verdicts_in(scene) == {(shader.name, ""): SUBSTITUTED}
    fed(thermal, "Temperature", "ShaderNodeTexNoise")
    assert verdicts_in(scene) == {(shader.name, ""): UPSAMPLED, ("Blackbody", "Color"): APPROXIMATED}


def test_lights_and_worlds_are_checked(scene):
    lamp = light(scene, "POINT", 10.0).data
    assert verdicts_in(scene, "light")["", "Color"] == SUBSTITUTED
    lamp.lensfield.emission = "no-such-lamp"
    assert verdicts_in(scene, "light")["", "emission spectrum"] == REJECTED
    tree = scene.world.node_tree
    sky = tree.nodes.new("ShaderNodeTexSky")
    tree.links.new(sky.outputs[0], background(scene).inputs["Color"])
    finding = next(finding for finding in lint(scene) if finding.node == "Sky Texture")
    assert str(finding).startswith("world 'World' > Sky Texture > Color: approximated: ") and not finding.object_names


def test_grease_pencil_is_rejected(scene):
    data = getattr(bpy.data, "grease_pencils_v3", bpy.data.grease_pencils)
    scene.collection.objects.link(bpy.data.objects.new("Strokes", data.new("Strokes")))
    finding = lint(scene)[0]
    assert finding.verdict == REJECTED and finding.object_names == ("Strokes",) and "Grease" not in finding.node


def test_findings_are_unique_and_sorted_worst_first(scene):
    for name in ("First", "Second"):
        shader = painted(scene, "ShaderNodeBsdfPrincipled", name)
        shader.inputs["Sheen Weight"].default_value = 1
        fed(shader, "Sheen Tint", "ShaderNodeTexSky")
    shader.inputs["Thin Film Thickness"].default_value = 100
    wall(scene, bpy.data.materials["First"])
    findings = lint(scene)
    order = [VERDICTS.index(finding.verdict) for finding in findings]
    assert order == sorted(order) and findings[0].block_name == "Second"
    assert len(set(findings)) == len(findings)
    assert {finding.object_names for finding in findings if finding.block_name == "First"} == {("Wall", "Wall.002")}


@pytest.fixture
def filmed(scene, tmp_path):
    """A .blend with a thin film, and one whose nodes are all supported."""
    shader = painted(scene, "ShaderNodeBsdfPrincipled")
    good, bad = tmp_path / "good.blend", tmp_path / "bad.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(good))
    shader.inputs["Thin Film Thickness"].default_value = 400
    bpy.ops.wm.save_as_mainfile(filepath=str(bad))
    return good, bad


def test_command_prints_findings_and_fails_on_rejection(filmed, capsys):
    good, bad = map(str, filmed)
    assert cli.main(["lint", good]) == 0
    assert "2 substituted" in capsys.readouterr().out.splitlines()
    assert cli.main(["lint", bad]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("Wall: material 'Paint' > Principled BSDF > Thin Film Thickness: rejected: ")
    assert lines[3] == "1 rejected, 2 substituted"
    assert lines[-1].startswith("refused: Wall: material 'Paint' > ")
    assert cli.main(["lint", bad, "--json"]) == 1
    report = json.loads(capsys.readouterr().out)
    first = report["nodes"][0]
    assert report["refusals"][0]["where"] == "Wall: material 'Paint' > Principled BSDF > Thin Film Thickness"
    assert first["verdict"] == REJECTED and first["object_names"] == ["Wall"]
    assert cli.main(["lint", "missing.blend"]) == 1
    assert "missing.blend: scene is missing" in capsys.readouterr().err


def test_json_output_excludes_messages_from_blender(filmed, monkeypatch, capfd):
    real = addon.preflight

    def chattering(*args, **kwargs):
        os.write(1, b"cycles | WARNING no such device\n")
        return real(*args, **kwargs)

    monkeypatch.setattr(addon, "preflight", chattering)
    assert cli.main(["lint", str(filmed[0]), "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["nodes"]


def test_sample_scene_has_nothing_rejected_or_separated(capsys):
    assert cli.main(["lint", str(SAMPLE_SCENE)]) == 0
    assert not {REJECTED, SEPARATED} & {word.strip(":") for word in capsys.readouterr().out.split()}


def test_panel_shows_the_findings_of_check_scene_and_selects_objects(scene):
    wall(scene, material("Plain", "ShaderNodeBsdfDiffuse")[0])
    painted(scene, "ShaderNodeBsdfPrincipled").inputs["Thin Film Thickness"].default_value = 400
    assert bpy.ops.lensfield.lint() == {"FINISHED"}
    assert [finding.verdict for finding in session.check.result.findings].count(REJECTED) == 1
    assert session.check.scene_uid == scene.session_uid
    assert bpy.ops.lensfield.select_object(finding=0) == {"FINISHED"}
    assert [obj.name for obj in scene.objects if obj.select_get()] == ["Wall.001"]
    layout = Layout()
    lint_panel.draw_preflight(layout, session.check.result)
    assert [icon for _, icon in layout.labels if icon != "BLANK1"] == [
        "RENDER_STILL", "CANCEL", *["INFO"] * 3, "CANCEL", "INFO"]  # remarks on view, light and distance
    said, finding = " ".join(text for text, _ in layout.labels), session.check.result.findings[0]
    assert str(finding) in said and lint_panel.UNFIT in said
    assert said.count(finding.text) == 2  # as the reason for a render per wavelength, and in its own line
    icons = bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items.keys()
    assert {*lint_panel.ICONS.values(), "RESTRICT_SELECT_OFF", "VIEWZOOM", "INFO"} <= set(icons)


class Layout:
    """Records drawn items, because a panel requires a window."""

    def __init__(self):
        self.labels = []

    def column(self, **_):
        return self

    row = column

    def label(self, text, icon="NONE"):
        self.labels.append((text, icon))

    def operator(self, *_, **__):
        return self


@pytest.mark.parametrize("tint, changes, least, most", [
    ("Specular Tint", {"IOR": 1.5}, -0.045, -0.03), ("Specular Tint", {"IOR": 2.5}, -0.18, -0.15),
    ("Sheen Tint", {"Sheen Weight": 1.0, "Sheen Roughness": 0.5}, -0.12, -0.07),
    ("Sheen Tint", {"Sheen Weight": 1.0, "Sheen Roughness": 1.0}, -0.48, -0.36),
    ("Specular Tint", {"Metallic": 1.0}, 0, 0), ("Specular Tint", {"Specular IOR Level": 0.0}, 0, 0),
    ("Coat Tint", {"Coat Weight": 1.0}, 0, 0), ("Base Color", {}, 0, 0)])
def test_wavelengths_in_a_shared_pass_are_independent_except_for_two_tints(scene, tmp_path, tint, changes, least, most):
    """For a tint, the darkest of three values in a pass, against that value alone; the brightest loses nothing."""
    shader = painted(scene, "ShaderNodeBsdfPrincipled")
    slanted(scene)
    for name, value in changes.items():
        shader.inputs[name].default_value = value

    def rendered(*values):
        shader.inputs[tint].default_value = (*values, 1)
        return picture(scene, tmp_path, samples=1024)

    together, bright, dark = rendered(1, 0.5, 0.05), rendered(1, 1, 1)[0], rendered(0.05, 0.05, 0.05)[2]
    assert_means(together[0], bright, noise=0.01)
    middle, slack = 1 + (least + most) / 2, (most - least) / 2
    assert_means(together[2], middle * dark, max(slack / middle, ROUNDING), noise=0.01)
    assert verdicts_in(scene).get((shader.name, tint)) is None  # now grey
    rendered(1, 0.5, 0.05)
    assert verdicts_in(scene).get((shader.name, tint)) == (SEPARATED if most else None)


def slanted(scene):
    """A slanted view of the wall, under a uniform sky; all pixels are equal."""
    set_world(scene)
    scene.camera.data.angle = 0.05
    bpy.data.objects["Wall"].rotation_euler.x = 0.9


def test_a_thin_film_gives_a_grey_colour(scene, tmp_path):
    shader = painted(scene, "ShaderNodeBsdfPrincipled")
    slanted(scene)
    shader.inputs["Thin Film Thickness"].default_value = 400
    least, _, most = sorted(picture(scene, tmp_path, samples=64), key=np.mean)
    assert surely_apart(most, least) > 0.005 * least.mean()
    shader.inputs["Thin Film Thickness"].default_value = 0.09  # nm: THINNEST_FILM_NM
    grey = picture(scene, tmp_path, samples=16).mean(axis=(1, 2))
    np.testing.assert_allclose(grey, grey[0], rtol=1e-6)


def test_melanin_gives_grey_hair_colour(scene, tmp_path):
    shader = painted(scene, "ShaderNodeBsdfHairPrincipled")
    set_world(scene)
    shader.parametrization = "MELANIN"
    red, _, blue = picture(scene, tmp_path, samples=64)
    assert blue.mean() < red.mean() and surely_apart(blue, red) > 0.1 * red.mean()


GRID_NM = np.arange(BAND_NM[0], BAND_NM[1] + 1, 5.0)


def upsampling_error(true_at):
    """RMS error of a light converted through linear Rec. 709, 400 to 700 nm, relative to its mean, at equal luminance.
    """
    true = true_at(GRID_NM)
    upsampled = emission_basis(GRID_NM) @ np.maximum(XYZ_TO_REC709 @ (colour_matching(GRID_NM).T @ true), 0)
    luminous = colour_matching(GRID_NM)[:, 1]
    off = luminous @ true / (luminous @ upsampled) * upsampled - true
    in_range = (GRID_NM >= 400) & (GRID_NM <= 700)
    return np.sqrt(np.mean(off[in_range]**2)) / true[in_range].mean()


@pytest.mark.parametrize("temperature_k, error", [(2856, 0.24), (4000, 0.09)])
def test_bias_of_an_upsampled_blackbody(temperature_k, error):
    assert re.search(f"{100 * error:.0f} % (rms )?at {temperature_k} K", node_rules.BLACKBODY_BIAS)
    assert upsampling_error(blackbody(temperature_k).at) == pytest.approx(error, abs=0.015)


# S0, S1 and S2 of CIE 015, 380 to 780 nm in steps of 20 nm.
DAYLIGHT = np.array([
    [63.4, 94.8, 105.9, 113.9, 125.5, 121.3, 113.5, 106.5, 105.3, 100.0, 95.1, 90.5, 88.4, 85.1, 82.6, 81.3, 74.3, 63.3,
     77.0, 47.7, 65.0],
    [38.5, 43.4, 37.1, 35.9, 27.9, 20.1, 13.2, 6.1, 1.9, -1.6, -3.5, -7.2, -9.5, -10.7, -14.0, -12.0, -12.9, -11.6,
     -10.2, -7.8, -10.4],
    [3.0, -1.1, -0.7, -2.6, -2.6, -1.8, -1.3, -0.5, 0.0, 0.2, 2.1, 4.1, 5.1, 7.3, 9.8, 8.3, 8.5, 7.6, 6.7, 5.2, 6.8]])


@pytest.mark.parametrize("temperature_k, error", [(12000, 0.10), (20000, 0.14)])
def test_bias_of_an_upsampled_sky(temperature_k, error):
    assert re.search(f"{100 * error:.0f} % (rms )?at {temperature_k} K", node_rules.SKY_BIAS)
    x = 0.237040 + 247.48 / temperature_k + 1.9018e6 / temperature_k**2 - 2.0064e9 / temperature_k**3  # CIE 015
    y = -3 * x**2 + 2.870 * x - 0.275
    part = 0.0241 + 0.2562 * x - 0.7341 * y
    weights = 1, (-1.3515 - 1.7703 * x + 5.9114 * y) / part, (0.03 - 31.4424 * x + 30.0717 * y) / part
    daylight = weights @ DAYLIGHT
    assert upsampling_error(lambda nm: np.interp(nm, np.arange(380, 781, 20.0), daylight)) == \
        pytest.approx(error, abs=0.02)


def test_bias_of_a_wavelength_node(scene, tmp_path):
    """With the colours of Cycles' node; at most a quarter of the light remains near its wavelength."""
    shader = painted(scene, "ShaderNodeEmission")
    node = fed(shader, "Color", "ShaderNodeWavelength")
    shares = []
    for wavelength_nm in (450.0, 500.0, 550.0, 589.0, 650.0):
        node.inputs["Wavelength"].default_value = wavelength_nm
        light_at = emission_basis(GRID_NM) @ picture(scene, tmp_path, samples=1, columns=4, rows=4)[:, 0, 0]
        shares.append(light_at[np.abs(GRID_NM - wavelength_nm) <= 10].sum() / light_at.sum())
    assert max(shares) < 0.26 and min(shares) > 0.05


def test_bias_of_a_conductor_with_three_indices():
    """Gold, of Johnson and Christy (1972): wavelength (from eV), n, k."""
    ev, n, k = np.array([
        [1.64, 0.14, 4.542], [1.76, 0.13, 4.103], [1.88, 0.14, 3.697], [2.01, 0.21, 3.272], [2.14, 0.29, 2.863],
        [2.26, 0.43, 2.455], [2.38, 0.62, 2.081], [2.50, 1.04, 1.833], [2.63, 1.31, 1.849], [2.75, 1.38, 1.914],
        [2.88, 1.45, 1.948], [3.00, 1.46, 1.958], [3.12, 1.47, 1.952]]).T
    nm = np.arange(400.0, 701.0, 5.0)

    def index_at(values, at_nm):
        return np.interp(at_nm, 1239.84 / ev[::-1], values[::-1])

    def reflectance(n, k):
        return ((n - 1)**2 + k**2) / ((n + 1)**2 + k**2)

    channels_nm = (611.4, 549.1, 464.2)
    n3, k3 = (channel_basis(nm) @ index_at(values, channels_nm) for values in (n, k))
    off = reflectance(n3, k3) - reflectance(index_at(n, nm), index_at(k, nm))
    assert "-0.05 to +0.08" in closure_rules.INDICES
    assert (off.min(), off.max()) == pytest.approx((-0.05, 0.08), abs=0.01)


def test_a_grey_stays_a_flat_spectrum():
    """Grey tints must not count as coloured after conversion to spectra."""
    np.testing.assert_allclose(reflectance_basis(GRID_NM[4:-16]).sum(axis=1), 1, atol=1e-5)
