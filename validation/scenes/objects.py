"""Objects: instances, hair, modifiers, displacement, points, volumes, curves, text; tiny, huge and far-away scenes."""

from math import radians

import bmesh
import bpy
import numpy as np

from .kit import (
    box,
    collection,
    cone,
    link,
    mesh_of,
    ordinary,
    painted,
    plane,
    shaded,
    sphere,
)


@ordinary()
def collection_instances(stage):
    """Instances of a collection, turned and scaled"""
    source = bpy.data.collections.new("Pieces")
    source.objects.link(stage.link("Piece", cone(0.05, 0.15, painted("Red", (0.6, 0.08, 0.08)))))
    stage.scene.collection.objects.unlink(bpy.data.objects["Piece"])
    for number, (x, y) in enumerate(((-0.35, 0.3), (0.3, 0.2), (0.0, -0.3))):
        empty = stage.link(f"Instance {number}", None, (x, y, 0))
        empty.instance_type, empty.instance_collection = "COLLECTION", source
        empty.scale, empty.rotation_euler.x = (1 + 0.3 * number,) * 3, radians(8 * number)


@ordinary()
def instances_on_faces(stage):
    """Instances on the faces of a mesh"""
    parent = stage.link("Grid", plane(0.35, None, "Grid", rows=4), (0, 0.1, 0.02))
    child = stage.link("Stud", sphere(0.03, painted("Studs", (0.7, 0.6, 0.1)), rings=8))
    child.parent = parent
    parent.instance_type, parent.show_instancer_for_render = "FACES", False


def node_group(name, links, nodes):
    """A geometry node group: nodes (name, type, values), and links (node, socket, node, socket)."""
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    made = {"in": tree.nodes.new("NodeGroupInput"), "out": tree.nodes.new("NodeGroupOutput")}
    for key, kind, values in nodes:
        made[key] = tree.nodes.new(kind)
        for socket, value in values.items():
            if socket in made[key].inputs:
                made[key].inputs[socket].default_value = value
            else:
                setattr(made[key], socket, value)
    for source, output, sink, given in links:
        tree.links.new(made[source].outputs[output], made[sink].inputs[given])
    return tree


def with_nodes(thing, tree):
    """Give an object geometry nodes."""
    modifier = thing.modifiers.new("Nodes", "NODES")
    modifier.node_group = tree
    return modifier


@ordinary()
def geometry_nodes_instances(stage):
    """Instances scattered by geometry nodes"""
    grass = painted("Grass", (0.15, 0.4, 0.05))
    tree = node_group("Scatter", [
        ("in", 0, "join", 0), ("in", 0, "points", 0), ("points", 0, "instance", 0), ("cone", 0, "paint", 0),
        ("paint", 0, "instance", 2), ("instance", 0, "join", 0), ("join", 0, "out", 0)], [
        ("join", "GeometryNodeJoinGeometry", {}), ("instance", "GeometryNodeInstanceOnPoints", {}),
        ("points", "GeometryNodeDistributePointsOnFaces", {"Density": 60.0}),
        ("cone", "GeometryNodeMeshCone", {"Radius Bottom": 0.015, "Depth": 0.12}),
        ("paint", "GeometryNodeSetMaterial", {"Material": grass})])
    with_nodes(stage.floor, tree)


@ordinary()
def set_material_in_nodes(stage):
    """Set Material in geometry nodes, on an object without material slots"""
    bare = stage.link("Bare", sphere(0.1, None), (-0.1, -0.3, 0.1))
    tree = node_group("Paint", [("in", 0, "paint", 0), ("paint", 0, "out", 0)], [
        ("paint", "GeometryNodeSetMaterial", {"Material": painted("Violet", (0.4, 0.1, 0.5))})])
    with_nodes(bare, tree)


@ordinary(differs="Camera Info")
def camera_info_in_nodes(stage):
    """A cone whose size follows the width of the camera's sensor, by geometry nodes"""
    if not hasattr(bpy.types, "GeometryNodeCameraInfo"):  # added in 5.0
        return
    tree = node_group("Follow", [
        ("active", 0, "camera", 0), ("camera", "Sensor", "parts", 0), ("parts", 0, "ratio", 0),
        ("in", 0, "resize", 0), ("ratio", 0, "resize", "Scale"), ("resize", 0, "out", 0)], [
        ("active", "GeometryNodeInputActiveCamera", {}), ("camera", "GeometryNodeCameraInfo", {}),
        ("parts", "ShaderNodeSeparateXYZ", {}), ("ratio", "ShaderNodeMath", {"operation": "DIVIDE"}),
        ("resize", "GeometryNodeTransform", {})])
    stage.camera.data.sensor_width, stage.camera.data.lens = 24, 28
    tree.nodes["Math"].inputs[1].default_value = 24
    with_nodes(stage.cone, tree)


@ordinary()
def point_cloud(stage):
    """A point cloud"""
    tree = node_group("Points", [("in", 0, "points", 0), ("points", 0, "paint", 0), ("paint", 0, "out", 0)], [
        ("points", "GeometryNodeMeshToPoints", {"Radius": 0.03}),
        ("paint", "GeometryNodeSetMaterial", {"Material": painted("Sand", (0.7, 0.55, 0.3))})])
    with_nodes(stage.link("Cloud", sphere(0.16, None, rings=6), (0.2, 0.15, 0.3)), tree)


@ordinary()
def particle_hair(stage):
    """Hair of the old particle system"""
    stage.ball.modifiers.new("Fur", "PARTICLE_SYSTEM")
    settings = stage.ball.particle_systems[0].settings
    settings.type, settings.count, settings.hair_length = "HAIR", 400, 0.08
    settings.root_radius, settings.tip_radius, settings.radius_scale = 1.0, 0.2, 0.006


@ordinary()
def hair_curves(stage):
    """New hair: curves with a radius, and the Principled Hair BSDF by colour"""
    rng = np.random.default_rng(5)
    curves = bpy.data.hair_curves.new("Hair")
    count, points = 200, 5
    curves.add_curves([points] * count)
    turns, rise = rng.uniform(0, 2 * np.pi, count), rng.uniform(0.2, 1, count)
    roots = np.stack([np.cos(turns) * np.sqrt(1 - rise**2), np.sin(turns) * np.sqrt(1 - rise**2), rise], axis=-1)
    steps = np.linspace(1, 1.8, points)[None, :, None]
    places = roots[:, None] * steps * 0.13 - np.array([0, 0, 0.03]) * (steps - 1) ** 2
    curves.position_data.foreach_set("vector", places.astype(np.float32).ravel())
    radius = curves.attributes.new("radius", "FLOAT", "POINT")
    radius.data.foreach_set("value", np.full(count * points, 0.004, np.float32))
    hair = shaded("Hair", "ShaderNodeBsdfHairPrincipled")[0]
    curves.materials.append(hair)
    stage.link("Hair", curves, stage.ball.location)


@ordinary()
def modifiers(stage):
    """Bevel, array, mirror, solidify, boolean and subdivision"""
    stage.cube.modifiers.new("Bevel", "BEVEL").width = 0.02
    cutter = stage.link("Cutter", sphere(0.08, None), (0.2, -0.2, 0.14))
    cutter.hide_render = True
    cut = stage.cube.modifiers.new("Cut", "BOOLEAN")
    cut.object, cut.operation = cutter, "DIFFERENCE"
    array = stage.cone.modifiers.new("Array", "ARRAY")
    array.count, array.relative_offset_displace = 3, (-1.1, 0, 0)
    stage.ball.modifiers.new("Smooth", "SUBSURF").render_levels = 2
    leaf = stage.link("Leaf", plane(0.08, painted("Leaf", (0.2, 0.5, 0.1))), (-0.1, -0.35, 0.1))
    leaf.modifiers.new("Mirror", "MIRROR").use_axis = (False, True, False)
    leaf.modifiers.new("Thick", "SOLIDIFY").thickness = 0.02


@ordinary()
def armature_and_shape_key(stage):
    """A mesh bent by an armature, with a shape key"""
    stage.cube.shape_key_add(name="Basis")
    key = stage.cube.shape_key_add(name="Tall")
    for point in key.data:
        point.co.z *= 2
    key.value = 0.6
    rig = stage.link("Rig", bpy.data.armatures.new("Rig"), stage.cone.location)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    bone = rig.data.edit_bones.new("Bone")
    bone.head, bone.tail = (0, 0, 0), (0, 0, 0.3)
    bpy.ops.object.mode_set(mode="OBJECT")
    rig.pose.bones["Bone"].rotation_mode = "XYZ"
    rig.pose.bones["Bone"].rotation_euler.x = radians(15)
    stage.cone.vertex_groups.new(name="Bone").add(list(range(len(stage.cone.data.vertices))), 1.0, "REPLACE")
    stage.cone.modifiers.new("Armature", "ARMATURE").object = rig


@ordinary()
def displacement(stage):
    """True displacement by a shader, with adaptive subdivision where this Blender has it"""
    material = stage.ball.data.materials[0]
    tree = material.node_tree
    noise, node = tree.nodes.new("ShaderNodeTexNoise"), tree.nodes.new("ShaderNodeDisplacement")
    noise.inputs["Scale"].default_value = 12
    node.inputs["Scale"].default_value = 0.05
    output = next(each for each in tree.nodes if each.bl_idname == "ShaderNodeOutputMaterial")
    tree.links.new(noise.outputs[0], node.inputs["Height"])
    tree.links.new(node.outputs[0], output.inputs["Displacement"])
    material.displacement_method = "BOTH"
    stage.ball.modifiers.new("Fine", "SUBSURF").render_levels = 2


@ordinary()
def text_and_curves(stage):
    """Text, a curve with a bevel, and a metaball"""
    text = stage.link("Text", bpy.data.curves.new("Text", "FONT"), (-0.35, -0.3, 0.01))
    text.data.body, text.data.size, text.data.extrude = "Lens", 0.18, 0.02
    text.rotation_euler.x = radians(90)
    text.data.materials.append(painted("Text", (0.7, 0.1, 0.1)))
    curve = bpy.data.curves.new("Wire", "CURVE")
    curve.dimensions, curve.bevel_depth = "3D", 0.01
    spline = curve.splines.new("BEZIER")
    spline.bezier_points.add(1)
    for point, place in zip(spline.bezier_points, ((-0.4, 0.3, 0.05), (0.45, 0.3, 0.5)), strict=True):
        point.co, point.handle_left_type, point.handle_right_type = place, "AUTO", "AUTO"
    curve.materials.append(painted("Wire", (0.1, 0.5, 0.5)))
    stage.link("Wire", curve)
    meta = bpy.data.metaballs.new("Drop")
    meta.render_resolution = 0.02
    meta.elements.new().radius = 0.15
    meta.materials.append(painted("Drop", (0.6, 0.6, 0.1)))
    stage.link("Drop", meta, (0.35, -0.25, 0.08))


@ordinary()
def volume_grid(stage):
    """A volume object from a grid, with Principled Volume"""
    fog = shaded("Fog", "ShaderNodeVolumePrincipled", Density=1.0)[0]
    tree = node_group("Fog", [("cube", 0, "paint", 0), ("paint", 0, "out", 0)], [
        ("cube", "GeometryNodeVolumeCube", {"Density": 3.0, "Min": (-0.15, -0.15, 0), "Max": (0.15, 0.15, 0.3)}),
        ("paint", "GeometryNodeSetMaterial", {"Material": fog})])
    with_nodes(stage.link("Fog", plane(0.1, None), (0.05, 0.1, 0)), tree)


@ordinary()
def fog_in_a_box(stage):
    """Fog in a box around the scene's middle"""
    stage.link("Fog", box((1.2, 0.5, 0.5), shaded("Fog", "ShaderNodeVolumeScatter", Density=0.8)[0]), (0, 0.3, 0.26))


@ordinary()
def mirrored_object(stage):
    """Negative scale, and a sheared child"""
    stage.cube.scale = (-1.2, 0.8, 1.4)
    stage.cone.parent, stage.cone.rotation_euler = stage.cube, (0, radians(20), radians(30))
    stage.cone.location = (0.0, 0.4, 0)


@ordinary()
def face_materials(stage):
    """Several materials on a mesh, one of them on the object"""
    for colour in ((0.8, 0.1, 0.1), (0.8, 0.7, 0.1)):
        stage.cube.data.materials.append(painted("Side", colour))
    stage.cube.data.polygons.foreach_set("material_index", [0, 1, 2, 1, 2, 0])
    stage.ball.material_slots[0].link = "OBJECT"
    stage.ball.material_slots[0].material = painted("Own", (0.5, 0.1, 0.4))


@ordinary()
def custom_normals(stage):
    """Smooth shading by angle, and loose edges"""
    mesh = bmesh.new()
    mesh.from_mesh(stage.cube.data)
    bmesh.ops.subdivide_edges(mesh, edges=mesh.edges[:], cuts=2)
    mesh.to_mesh(stage.cube.data)
    mesh.free()
    stage.cube.data.polygons.foreach_set("use_smooth", [True] * len(stage.cube.data.polygons))
    if hasattr(stage.cube.data, "set_sharp_from_angle"):
        stage.cube.data.set_sharp_from_angle(angle=radians(40))


@ordinary()
def leaves(stage):
    """Three hundred overlapping leaves with alpha"""
    rng = np.random.default_rng(9)
    leaf = painted("Leaf", (0.15, 0.4, 0.05), Alpha=0.6)
    corners, faces = [], []
    for number in range(300):
        centre, across, along = (rng.normal(0, scale, 3) for scale in (0.1, 0.03, 0.03))
        corners += [centre + across, centre + along, centre - across, centre - along]
        faces.append(range(4 * number, 4 * number + 4))
    stage.link("Tree", mesh_of("Tree", corners, faces, leaf), (-0.05, 0.1, 0.3))


@ordinary()
def dupli_of_lamps(stage):
    """A lamp inside an instanced collection"""
    source = bpy.data.collections.new("Lantern")
    source.objects.link(stage.lamp)
    stage.scene.collection.objects.unlink(stage.lamp)
    for number, x in enumerate((0, 0.6)):
        empty = stage.link(f"Lantern {number}", None, (x, 0, 0))
        empty.instance_type, empty.instance_collection = "COLLECTION", source


@ordinary()
def far_away(stage):
    """A scene ten kilometres from the origin"""
    for thing in stage.scene.objects:
        thing.location += type(thing.location)((4096, 8192, 0))


@ordinary(refused="Blender draws it over the picture")
def grease_pencil(stage):
    """A Grease Pencil drawing"""
    data = (bpy.data.grease_pencils_v3 if hasattr(bpy.data, "grease_pencils_v3") else bpy.data.grease_pencils
            ).new("Drawing")
    layer = data.layers.new("Lines")
    drawing = layer.frames.new(1).drawing
    drawing.add_strokes([3])
    for point, place in zip(drawing.strokes[0].points, ((-0.3, 0, 0), (0, 0, 0.3), (0.3, 0, 0)), strict=True):
        point.position, point.radius = place, 0.02
    stage.link("Drawing", data)


@ordinary()
def sub_collections(stage):
    """Nested collections, an object in two of them, and an empty one"""
    outer = collection(stage, "Outer", stage.ball)
    inner = bpy.data.collections.new("Inner")
    outer.children.link(inner)
    inner.objects.link(stage.cube)
    inner.objects.link(stage.ball)
    outer.children.link(bpy.data.collections.new("Empty"))
    link(stage.scene, "Note", None)
