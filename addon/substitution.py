"""Substitution: every colour of the scene becomes its values at the three wavelengths of a pass.

Materials, lights, worlds and the node groups in them get stand-ins whose colour inputs are wired, once, to Attribute
nodes that read properties of the scene. Between passes only those properties change, so that Cycles keeps its
geometry and shaders.

A colour that is known (a constant, or an assigned spectrum) becomes one attribute. A colour that is computed by nodes
goes through a node group that upsamples it: the bases are linear, so a value at one wavelength is a dot product with
the colour.
"""

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ..engine.errors import InputError
from ..engine.spectra import (BAND_NM, Spectrum, blackbody, channel_basis, emission_basis, load_spectrum,
                              reflectance_basis, white_density)
from .errors import SceneError

PROPERTY_PREFIX = "lensfield_"
RENDER_SCALE = BAND_NM[1] - BAND_NM[0]
"""Cycles renders spectral radiance times this, about as bright as in RGB: its light threshold is an absolute figure,
and at the radiance of a single nanometre it would throw nearly all light samples away."""

REFLECTANCE, EMISSION, CHANNELS = "reflectance", "emission", "channels"
BASIS = {REFLECTANCE: reflectance_basis, CHANNELS: channel_basis,
         EMISSION: lambda wavelengths_nm: RENDER_SCALE * emission_basis(wavelengths_nm)}
EMITTING_NODES = {"ShaderNodeEmission", "ShaderNodeBackground"}
EMITTING_SOCKETS = {"Emission Color", "Emission", "Blackbody Tint", "Emission Coefficients"}
CHANNEL_SOCKETS = {"Radius", "Subsurface Radius", "IOR", "Extinction", "Absorption Coefficient",
                   "Absorption Coefficients", "Scatter Coefficients"}
"""Vectors that hold one value for each of red, green and blue, though they are no colours."""
BASE_COLOUR_SOCKETS = {"Base Color", "Color"}
NOT_REFLECTING = {"ShaderNodeBsdfTransparent", "ShaderNodeVolumeAbsorption", "ShaderNodeVolumeScatter",
                  "ShaderNodeVolumePrincipled"}


@dataclass(frozen=True, eq=False)
class Assigned:
    """Spectra that the user gave a data-block, and the tint (a function of wavelengths) of all that it emits."""

    reflectance: Spectrum | None = None
    emission: Spectrum | None = None
    tint: object = None

    def spectrum_for(self, node, socket, kind):
        """The spectrum that takes the place of this socket's colour, or None."""
        if kind == EMISSION:
            return self.emission
        takes_it = socket.name in BASE_COLOUR_SOCKETS and node.bl_idname not in NOT_REFLECTING
        return self.reflectance if takes_it and kind == REFLECTANCE else None


NOTHING_ASSIGNED = Assigned()


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
        self._groups = {}
        self._upsamplers = {kind: self._make_upsampler(kind) for kind in BASIS}
        for material in list(bpy.data.materials):
            if material.users and not material.is_grease_pencil:
                self._substitute_material(material)
        for light in list(bpy.data.lights):
            if light.users:
                self._substitute_light(light)
        for world in {scene.world, *(layer.world_override for layer in scene.view_layers)} - {None}:
            self._substitute_world(world)

    def set_wavelengths(self, wavelengths_nm):
        """Give every attribute its values at these three wavelengths."""
        for name, values_at in self._values.items():
            self._scene[name] = [float(value) for value in values_at(wavelengths_nm)]
        self._scene.update_tag()  # or persistent data keeps the values of the first pass

    def _substitute_material(self, material):
        stand_in = self._stand_in(material, bpy.data.materials)
        if not _uses_nodes(material):
            _single_shader(stand_in, "ShaderNodeBsdfDiffuse", "ShaderNodeOutputMaterial", material.diffuse_color)
        self._substitute_tree(stand_in.node_tree, _assigned(material, "reflectance", "emission"))

    def _substitute_light(self, light):
        stand_in = self._stand_in(light, bpy.data.lights)
        if not _uses_nodes(light):
            _single_shader(stand_in, "ShaderNodeEmission", "ShaderNodeOutputLight", (1, 1, 1, 1))
        stand_in.color = (1, 1, 1)
        stand_in.use_temperature = False
        spectrum = _assigned(light, "emission").emission
        tint = None if spectrum else _light_tint(np.array(light.color),
                                                 light.temperature if light.use_temperature else None)
        self._substitute_tree(stand_in.node_tree, Assigned(emission=spectrum, tint=tint))

    def _substitute_world(self, world):
        stand_in = self._stand_in(world, bpy.data.worlds)
        if not _uses_nodes(world):
            _single_shader(stand_in, "ShaderNodeBackground", "ShaderNodeOutputWorld", (*world.color, 1))
        self._substitute_tree(stand_in.node_tree, _assigned(world, "emission"))

    def _stand_in(self, original, collection):
        stand_in = self._journal.stand_in(original, collection)
        stand_in.animation_data_clear()  # it holds this frame's values; animation would overwrite what is set here
        if stand_in.node_tree:
            stand_in.node_tree.animation_data_clear()
        return stand_in

    def _substitute_tree(self, tree, assigned):
        """Wire the colour inputs of every shader node of a tree, and of the groups in it."""
        for node in list(tree.nodes):
            if node.bl_idname == "ShaderNodeGroup" and node.node_tree:
                node.node_tree = self._substituted_group(node.node_tree, assigned)
            elif any(output.type == "SHADER" for output in node.outputs):
                for socket in node.inputs:
                    kind = _kind(node, socket)
                    if kind:
                        self._substitute_socket(tree, node, socket, kind, assigned)

    def _substituted_group(self, group, assigned):
        key = group.session_uid, assigned
        if key not in self._groups:
            copy = self._groups[key] = group.copy()
            self._groups[copy.session_uid, assigned] = copy
            self._journal.on_exit(lambda: bpy.data.node_groups.remove(copy))
            copy.animation_data_clear()
            self._substitute_tree(copy, assigned)
        return self._groups[key]

    def _substitute_socket(self, tree, node, socket, kind, assigned):
        spectrum = assigned.spectrum_for(node, socket, kind)
        tint = assigned.tint if kind == EMISSION else None
        if spectrum is not None:
            source = self._attribute(tree, _spectrum_values(spectrum, kind))
        elif socket.is_linked and not socket.links[0].is_muted:
            source = self._upsampled(tree, kind, socket.links[0].from_socket)
            if tint:
                source = self._multiplied(tree, source, self._attribute(tree, tint))
        else:
            source = self._attribute(tree, _colour_values(np.array(socket.default_value[:3]), kind, tint))
        tree.links.new(source, socket)

    def _attribute(self, tree, values_at):
        """Output of a node that gives `values_at(wavelengths)` for the wavelengths of the pass."""
        return _attribute_node(tree, self._property(values_at)).outputs["Color"]

    def _property(self, values_at):
        index = len(self._values)
        while (name := f"{PROPERTY_PREFIX}{index}") in self._scene:  # a property of the user's own
            index += 1
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


def _kind(node, socket):
    """How a shader node's input varies with wavelength, or None where it does not."""
    if socket.name in EMITTING_SOCKETS or (socket.type == "RGBA" and node.bl_idname in EMITTING_NODES):
        return EMISSION if socket.type in ("RGBA", "VECTOR") else None
    if socket.type == "RGBA":
        return REFLECTANCE
    return CHANNELS if socket.type == "VECTOR" and socket.name in CHANNEL_SOCKETS else None


def _uses_nodes(data_block):
    """Whether Blender renders a material, light or world by its node tree, or by its plain colour."""
    if data_block.node_tree is None:
        return False
    always = bpy.app.version >= (5, 0, 0) and not isinstance(data_block, bpy.types.Light)
    return always or data_block.use_nodes


def _single_shader(data_block, shader_type, output_type, colour):
    """Give a data-block the node tree that its plain colour stands for."""
    data_block.use_nodes = True
    tree = data_block.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new(shader_type)
    shader.inputs["Color"].default_value = colour
    tree.links.new(shader.outputs[0], tree.nodes.new(output_type).inputs[0])


def _attribute_node(tree, property_name):
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_type = "VIEW_LAYER"
    node.attribute_name = property_name
    return node


def _assigned(data_block, *fields):
    """The spectra in these fields of a data-block; raises SceneError for one that cannot be read."""
    spectra = {field: _read_spectrum(data_block, field) for field in fields}
    return Assigned(**spectra) if any(spectra.values()) else NOTHING_ASSIGNED


def _read_spectrum(data_block, field):
    text = getattr(data_block.lensfield, field).strip()
    if not text:
        return None
    try:
        # Blender writes paths beside the .blend as //name.
        spectrum = load_spectrum(bpy.path.abspath(text), Path(bpy.data.filepath).parent)
        if field == EMISSION:
            spectrum.density_at(BAND_NM)
        return spectrum
    except InputError as error:
        raise SceneError(f"{data_block.rna_type.name.lower()} {data_block.name!r}", f"{field} spectrum",
                         text, f"{error.field} {error.value}: {error.remedy}") from None


def _light_tint(colour, temperature_k):
    """What a light's colour and temperature make of white light, as a function of wavelengths; None for nothing."""
    if temperature_k is None:
        return None if np.allclose(colour, 1) else lambda nm: reflectance_basis(nm) @ colour
    thermal = blackbody(temperature_k)

    def tint(nm):
        white = white_density(nm)
        ratio = np.divide(thermal.density_at(nm), white, out=np.zeros_like(white), where=white > 0)
        return ratio * (reflectance_basis(nm) @ colour)

    return tint


def _spectrum_values(spectrum, kind):
    """Values of an assigned spectrum: reflectance as it is, emission as density."""
    if kind == REFLECTANCE:
        return spectrum.at
    return lambda nm: RENDER_SCALE * spectrum.density_at(nm)


def _colour_values(colour, kind, tint=None):
    """Values of a constant linear Rec. 709 colour, upsampled, tinted."""
    if tint is None:
        return lambda nm: BASIS[kind](nm) @ colour
    return lambda nm: (BASIS[kind](nm) @ colour) * tint(nm)
