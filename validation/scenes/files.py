"""Files: linked libraries with overrides, several scenes, compositor trees, scripts."""

import bpy

from .kit import cone, ordinary, painted


def _library(stage):
    """A library with a red cone in a collection; returns its path."""
    path = stage.folder / "library.blend"
    source = bpy.data.collections.new("Cones")
    source.objects.link(bpy.data.objects.new("Red Cone", cone(0.1, 0.3, painted("Red", (0.7, 0.05, 0.05)))))
    bpy.data.libraries.write(str(path), {source})
    bpy.data.objects.remove(bpy.data.objects["Red Cone"])
    bpy.data.collections.remove(source)
    for block in (bpy.data.materials["Red"], bpy.data.meshes["Cone.001"]):
        block.user_clear()
    bpy.data.orphans_purge()
    return path


def _linked(stage):
    with bpy.data.libraries.load(str(_library(stage)), link=True) as (source, target):
        target.collections = list(source.collections)
    return target.collections[0]


@ordinary()
def linked_collection(stage):
    """An instance of a collection that is linked from a library"""
    empty = stage.link("Instance", None, (-0.05, -0.3, 0))
    empty.instance_type, empty.instance_collection = "COLLECTION", _linked(stage)


@ordinary()
def library_override(stage):
    """A library override, whose object has moved and has another material"""
    linked = _linked(stage)
    over = linked.override_hierarchy_create(stage.scene, bpy.context.view_layer)
    thing = over.all_objects[0]
    thing.location = -0.05, -0.3, 0.0
    thing.scale = 1, 1, 1.4


@ordinary()
def linked_material(stage):
    """A material that is linked from a library"""
    _linked(stage)
    stage.ball.data.materials[0] = next(each for each in bpy.data.materials if each.library)


@ordinary()
def several_scenes(stage):
    """A second scene in the file, which shares objects"""
    other = bpy.data.scenes.new("Other")
    other.collection.objects.link(stage.cube)
    stage.scene.lensfield.output_folder = "//other/"


@ordinary(refused="background set")
def background_set(stage):
    """A background set"""
    other = bpy.data.scenes.new("Set")
    other.collection.objects.link(stage.cube)
    stage.scene.background_set = other


def compositor_tree(scene):
    """A compositor tree that doubles the exposure and passes alpha: the tree, in 5.x, or the scene's own."""
    if not hasattr(scene, "compositing_node_group"):
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
        return tree, tree.nodes.new("CompositorNodeComposite")
    tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    scene.compositing_node_group = tree
    return tree, tree.nodes.new("NodeGroupOutput")


@ordinary(plain={"compositing": True})
def compositor(stage):
    """A compositor tree behind the render: a stop brighter"""
    tree, output = compositor_tree(stage.scene)
    layers, exposure = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeExposure")
    exposure.inputs["Exposure"].default_value = 1.0
    tree.links.new(layers.outputs["Image"], exposure.inputs["Image"])
    tree.links.new(exposure.outputs["Image"], output.inputs[0])
    stage.scene.render.compositor_device = "CPU"


@ordinary()
def sequencer(stage):
    """A strip in the sequencer, which is ignored"""
    editor = stage.scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    strips.new_effect(name="Red", type="COLOR", channel=1, frame_start=1, **(
        {"length": 50} if bpy.app.version >= (5, 0, 0) else {"frame_end": 50}))


@ordinary(remark="Freestyle")
def freestyle(stage):
    """Freestyle lines, which are ignored"""
    stage.scene.render.use_freestyle = True


@ordinary(remark="Render Engine")
def eevee_file(stage):
    """A file that is set to EEVEE, rendered by Cycles"""
    names = [item.identifier for item in type(stage.scene.render).bl_rna.properties["engine"].enum_items]
    stage.scene.render.engine = next((name for name in ("BLENDER_EEVEE", "BLENDER_EEVEE_NEXT") if name in names),
                                     "BLENDER_EEVEE")


@ordinary()
def metadata_and_stamp(stage):
    """Stamps burnt into the picture, which are left out"""
    stage.scene.render.use_stamp = stage.scene.render.use_stamp_note = True
    stage.scene.render.stamp_note_text = "take 3"


@ordinary()
def persistent_data(stage):
    """Persistent data, and a render limited to one thread"""
    stage.scene.render.use_persistent_data = True
    stage.scene.render.threads_mode, stage.scene.render.threads = "FIXED", 1


