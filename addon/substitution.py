"""Substitution: every colour of the scene becomes its values at the three wavelengths of a pass.

Materials, lights, worlds and the node groups in them get stand-ins whose colour inputs are wired, once, to Attribute
nodes that read properties of the scene. Between passes only those properties change, so that Cycles keeps its
geometry and shaders.

A colour that is known (a constant, or an assigned spectrum) becomes one attribute. A colour that is computed by nodes
goes through a node group that upsamples it: the Mallett-Yuksel basis is linear, so a value at one wavelength is a dot
product with the colour.
"""

import bpy
import numpy as np

from ..engine.errors import InputError
from ..engine.spectra import BAND_NM, blackbody, emission_basis, load_spectrum, reflectance_basis
from .errors import SceneError

PROPERTY_PREFIX = "lensfield_"
REFLECTANCE, EMISSION = "reflectance", "emission"
RENDER_SCALE = BAND_NM[1] - BAND_NM[0]
"""Cycles renders spectral radiance times this, about as bright as in RGB: its light threshold is an absolute figure,
and at the radiance of a single nanometre it would throw nearly all light samples away."""
BASIS = {REFLECTANCE: reflectance_basis, EMISSION: lambda wavelengths_nm: RENDER_SCALE * emission_basis(wavelengths_nm)}
EMITTING_NODES = {"ShaderNodeEmission", "ShaderNodeBackground"}
EMITTING_SOCKETS = {"Emission Color", "Emission", "Blackbody Tint"}
BASE_COLOUR_SOCKETS = {"Base Color", "Color"}


class Substitution:
    """Wires a scene for spectral passes; undone by the journal.

    Parameters
    ----------
    scene : bpy.types.Scene
    journal : Journal

    Raises
    ------
    SceneError
        A spectrum that cannot be read, or a data-block that cannot be given a stand-in.
    """

    def __init__(self, scene, journal):
        self._scene = scene
        self._journal = journal
        self._values = {}
        self._trees = {}
        self._upsamplers = {kind: self._make_upsampler(kind) for kind in BASIS}
        for material in list(bpy.data.materials):
            if material.users and not material.is_grease_pencil:
                self._substitute_material(material)
        for light in list(bpy.data.lights):
            if light.users:
                self._substitute_light(light)
        if scene.world:
            self._substitute_world(scene.world)

    def set_wavelengths(self, wavelengths_nm):
        """Give every attribute its values at these three wavelengths."""
        for name, values_at in self._values.items():
            self._scene[name] = [float(value) for value in values_at(wavelengths_nm)]
        self._scene.update_tag()  # or persistent data keeps the values of the first pass

    def _substitute_material(self, material):
        stand_in = self._stand_in(material, bpy.data.materials)
        if not stand_in.node_tree:
            stand_in.use_nodes = True  # its plain colour, as Cycles renders it
            stand_in.node_tree.nodes.clear()
            diffuse = stand_in.node_tree.nodes.new("ShaderNodeBsdfDiffuse")
            diffuse.inputs["Color"].default_value = material.diffuse_color
            output = stand_in.node_tree.nodes.new("ShaderNodeOutputMaterial")
            stand_in.node_tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
        spectra = {REFLECTANCE: self._assigned(material, REFLECTANCE), EMISSION: self._assigned(material, EMISSION)}
        self._substitute_tree(stand_in.node_tree, spectra)

    def _substitute_light(self, light):
        stand_in = self._stand_in(light, bpy.data.lights)
        if not stand_in.node_tree or not stand_in.use_nodes:
            stand_in.use_nodes = True
        spectrum = self._assigned(light, EMISSION)
        colour = np.array(light.color)
        stand_in.color = (1, 1, 1)
        if spectrum is None and light.use_temperature:
            spectrum = blackbody(light.temperature)
        elif spectrum is not None:
            colour = np.ones(3)
        stand_in.use_temperature = False
        self._substitute_tree(stand_in.node_tree, {EMISSION: spectrum}, tint=colour)

    def _substitute_world(self, world):
        stand_in = self._stand_in(world, bpy.data.worlds)
        if not stand_in.node_tree:
            stand_in.use_nodes = True
            stand_in.node_tree.nodes["Background"].inputs["Color"].default_value = (*world.color, 1)
        self._substitute_tree(stand_in.node_tree, {EMISSION: self._assigned(world, EMISSION)})

    def _stand_in(self, original, collection):
        stand_in = self._journal.stand_in(original, collection)
        stand_in.animation_data_clear()  # it holds this frame's values; animation would overwrite what is set here
        if stand_in.node_tree:
            stand_in.node_tree.animation_data_clear()
        return stand_in

    def _assigned(self, data_block, field):
        text = getattr(data_block.lensfield, field)
        if not text.strip():
            return None
        try:
            return load_spectrum(text, bpy.path.abspath("//") or ".")
        except InputError as error:
            raise SceneError(f"{data_block.rna_type.name.lower()} {data_block.name!r}", f"{field} spectrum",
                             text, f"{error.field} {error.value}: {error.remedy}") from None

    def _substitute_tree(self, tree, spectra, tint=(1, 1, 1)):
        """Wire the colour inputs of every shader node of a tree, and of the groups in it."""
        for node in list(tree.nodes):
            if node.bl_idname == "ShaderNodeGroup" and node.node_tree:
                node.node_tree = self._substituted_group(node.node_tree)
            elif any(output.type == "SHADER" for output in node.outputs):
                for socket in node.inputs:
                    if socket.type == "RGBA":
                        self._substitute_socket(tree, node, socket, spectra, tint)

    def _substituted_group(self, group):
        if group.name not in self._trees:
            copy = group.copy()
            self._trees[group.name] = self._trees[copy.name] = copy
            self._journal.on_exit(lambda: bpy.data.node_groups.remove(copy))
            self._substitute_tree(copy, {})
        return self._trees[group.name]

    def _substitute_socket(self, tree, node, socket, spectra, tint):
        emits = node.bl_idname in EMITTING_NODES or socket.name in EMITTING_SOCKETS
        kind = EMISSION if emits else REFLECTANCE
        spectrum = spectra.get(kind)
        if spectrum is not None and (emits or socket.name in BASE_COLOUR_SOCKETS):
            source = self._attribute(tree, _spectrum_values(spectrum, kind, tint))
        elif socket.is_linked:
            source = self._upsampled(tree, kind, socket.links[0].from_socket)
            if not np.allclose(tint, 1):
                source = self._multiplied(tree, source, self._attribute(tree, _colour_values(tint, REFLECTANCE)))
        else:
            colour = np.array(socket.default_value[:3])
            source = self._attribute(tree, _colour_values(colour, kind, tint))
        tree.links.new(source, socket)

    def _attribute(self, tree, values_at):
        """Output of a node that gives `values_at(wavelengths)` for the wavelengths of the pass."""
        return _attribute_node(tree, self._property(values_at)).outputs["Color"]

    def _property(self, values_at):
        name = f"{PROPERTY_PREFIX}{len(self._values)}"
        self._values[name] = values_at
        self._scene[name] = [0.0, 0.0, 0.0]
        self._journal.on_exit(lambda: self._scene.pop(name, None))
        return name

    def _upsampled(self, tree, kind, colour):
        node = tree.nodes.new("ShaderNodeGroup")
        node.node_tree = self._upsamplers[kind]
        tree.links.new(colour, node.inputs[0])
        return node.outputs[0]

    def _multiplied(self, tree, first, second):
        node = tree.nodes.new("ShaderNodeVectorMath")
        node.operation = "MULTIPLY"
        tree.links.new(first, node.inputs[0])
        tree.links.new(second, node.inputs[1])
        return node.outputs[0]

    def _make_upsampler(self, kind):
        """Node group: linear Rec. 709 colour -> its values at the pass's three wavelengths."""
        group = bpy.data.node_groups.new(f"{PROPERTY_PREFIX}{kind}", "ShaderNodeTree")
        self._journal.on_exit(lambda: bpy.data.node_groups.remove(group))
        group.interface.new_socket(name="Color", in_out="INPUT", socket_type="NodeSocketColor")
        group.interface.new_socket(name="Spectral", in_out="OUTPUT", socket_type="NodeSocketColor")
        colour = group.nodes.new("NodeGroupInput").outputs[0]
        combine = group.nodes.new("ShaderNodeCombineColor")
        for channel in range(3):
            row = self._property(lambda nm, basis=BASIS[kind], channel=channel: basis(nm)[channel])
            product = group.nodes.new("ShaderNodeVectorMath")
            product.operation = "DOT_PRODUCT"
            group.links.new(colour, product.inputs[0])
            group.links.new(_attribute_node(group, row).outputs["Vector"], product.inputs[1])
            group.links.new(product.outputs["Value"], combine.inputs[channel])
        group.links.new(combine.outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
        return group


def _attribute_node(tree, property_name):
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_type = "VIEW_LAYER"
    node.attribute_name = property_name
    return node


def _spectrum_values(spectrum, kind, tint):
    """Values of an assigned spectrum: reflectance as it is, emission as density, tinted."""
    if kind == REFLECTANCE:
        return spectrum.at
    return lambda nm: RENDER_SCALE * spectrum.density_at(nm) * (reflectance_basis(nm) @ tint)


def _colour_values(colour, kind, tint=(1, 1, 1)):
    """Values of a constant linear Rec. 709 colour, upsampled, tinted."""
    return lambda nm: (BASIS[kind](nm) @ colour) * (reflectance_basis(nm) @ tint)
