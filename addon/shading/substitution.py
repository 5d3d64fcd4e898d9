"""Substitution: replaces every colour of the scene by its values at the wavelengths of a pass.

Stand-ins replace materials, lights, worlds and the node groups in them. The colour inputs of a stand-in are wired,
once, to Attribute nodes that read properties of the scene. Between passes only these properties change, so Cycles
keeps its geometry and shaders. Worlds have constants instead: Cycles samples a world's light by a map, and would build
it anew for each render, not only for other wavelengths.

A known colour (a constant, or an assigned spectrum) becomes one attribute. A colour computed by nodes goes through a
node group that upsamples it: the bases are linear, so the value at one wavelength is a dot product with the colour.
Emitters shine in their colour under the white light of their group; the spectra of lamps are applied later. If a
basis gives negative values for a colour outside Rec. 709, they are clamped at 0, because reflectance and emission
cannot be negative.
"""

from contextlib import suppress
from dataclasses import dataclass

import bpy
import numpy as np

from lensfield.engine.spectral.refraction import D_LINE_NM, Refraction
from lensfield.engine.spectral.spectra import BAND_NM, Spectrum, channel_basis

from ..scene.errors import SceneError
from ..scene.instances import cycles_output, uses_nodes
from ..scene.render_state import read_again
from ..scene.working_space import colour_basis
from .closure_rules import is_idle
from .lamps import Lamp, blackbody_temperature
from .lobes import EMISSIONS, shared_closures
from .lumens import give_lumens, luminous_efficacy
from .node_paths import constant_of, feeding, glowing_colour, source_of, window_outputs
from .spectral_sockets import CHANNELS, EMISSION, INDEX, REFLECTANCE, is_shader, kind, takes_reflectance
from .wiring import (
    attribute_node,
    constant_instead,
    emission_between,
    multiplied,
    property_of,
    single_shader,
    unfolded,
    upsampler,
)

PROPERTY_PREFIX = "lensfield_"
ESTIMATED = {"ShaderNodeEmission": "Strength", "ShaderNodeBsdfPrincipled": "Emission Strength"}
"""The nodes whose emission Cycles estimates, and their strengths. (It measures that of a world.)"""
LEAST_SAMPLED = 0.51  # Cycles samples a surface as a lamp if it estimates more than 0.5
BASIS = {REFLECTANCE: colour_basis, EMISSION: colour_basis, CHANNELS: channel_basis}


def _move_into_strength(socket, values):
    """Multiply the strength of a node by the mean of the values that its emission colour, a socket, is to have, and
    return the factor: Cycles then estimates the emission from the strength alone."""
    strength = socket.node.inputs[ESTIMATED[socket.node.bl_idname]]
    if strength.is_linked or strength.default_value <= 0 or values.mean() <= 0:
        return 1.0
    factor = max(float(values.mean()), min(float(values.max()), LEAST_SAMPLED / strength.default_value))
    strength.default_value *= factor
    return factor


@dataclass(frozen=True)
class Assigned:
    """The spectra assigned to a data-block, and the lamp that it shines with.

    Attributes
    ----------
    reflectance : Spectrum or None
    refraction : Refraction or None
    emission : Lamp or None
        Replaces all of its emission colours.
    lamp : Lamp or None
        The lamp that its emission colours filter; None if each input has a separate one.
    tint : (float, float, float)
        Multiplies everything that it emits, in the working space.
    shared_group : bool
        Whether its light group contains several spectra.
    """

    reflectance: Spectrum | None = None
    refraction: Refraction | None = None
    emission: Lamp | None = None
    lamp: Lamp | None = None
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0)
    shared_group: bool = False

    @property
    def metal(self):
        """Whether the refraction describes a metal."""
        return self.refraction is not None and self.refraction.metal


class Substitution:
    """Wires a scene for spectral passes; the journal undoes it.

    Parameters
    ----------
    scene : bpy.types.Scene
    journal : Journal
    spectra : AssignedSpectra
    lamps : Lamps
    groups : LightGroups
    rendered : collection of materials, lights and worlds
        The data-blocks that reach the render. The others are substituted too, but do not enter the attributes below.

    Attributes
    ----------
    factors : list of callable (wavelengths_nm) -> values
        The known reflectances and colours, which multiply light on its way.
    mixed_colours : bool
        Whether other colours are computed by nodes.
    refusals : list of SceneError
        Why rendered data-blocks cannot be substituted.
    materials : dict of str: str
        The name of each material, by the name of its stand-in.
    """

    def __init__(self, scene, journal, spectra, lamps, groups, rendered):
        self._scene, self._journal = scene, journal
        self._spectra, self._lamps, self._groups = spectra, lamps, groups
        self._values, self._indices, self._copies, self._sharing = {}, set(), {}, set()
        self._group_of = {}  # the lamp of the light group, by the names of properties for emission
        self._constants = []  # nodes in worlds, each with the name of the property that it replaces
        self._shown = ()  # the arguments of the last `set_wavelengths`
        self._window = {}  # names of the properties with the scale and offset of Window coordinates, once in use
        self.factors, self.mixed_colours, self.refusals, self.materials = [], False, [], {}
        self._upsamplers = {basis: self._make_upsampler(basis) for basis in set(BASIS.values())}
        worlds = {scene.world, *(layer.world_override for layer in scene.view_layers)} - {None}
        blocks = [(block, self._substitute_material) for block in bpy.data.materials
                  if block.users and not block.is_grease_pencil]
        blocks += [(block, self._substitute_light) for block in bpy.data.lights if block.users]
        blocks += [(block, self._substitute_world) for block in worlds]
        for block, substitute in blocks:
            if block in rendered:
                try:
                    substitute(block)
                except SceneError as error:
                    self.refusals.append(error)
        counted = list(self.factors), self.mixed_colours
        for block, substitute in blocks:
            if block not in rendered:
                with suppress(SceneError):  # not visible in the render
                    substitute(block)
        self.factors, self.mixed_colours = counted

    def set_wavelengths(self, wavelengths_nm, dispersive=False):
        """Set every attribute to its values at these three wavelengths; refractive indices only if `dispersive`."""
        if (shown := (tuple(wavelengths_nm), dispersive)) != self._shown:
            self._shown = shown
            for name, values_at in self._values.items():
                # without dispersion, all three channels take the index at the D line
                at_nm = np.full(3, D_LINE_NM) if name in self._indices and not dispersive else wavelengths_nm
                self._scene[name] = [float(value) for value in values_at(at_nm)]
            for name, node in self._constants:
                for socket, value in zip(node.inputs, self._scene[name], strict=True):
                    socket.default_value = value
        read_again(self._scene)

    def place_window(self, capture):
        """Let Window coordinates span the frame of the picture, without the overscan of a capture, a PixelGrid.

        In Cycles they span the capture, from its lower left corner; in a panorama, they ignore the camera's shift.
        """
        if not self._window:
            return
        (rows, columns), (row, column) = capture.shape_px, capture.centre_px
        margin_px = np.array(capture.overscan_px[::-1], dtype=float)
        if not capture.projection.is_plane:
            margin_px += (columns - 1) / 2 - column, row - (rows - 1) / 2
        frame_px = np.array(capture.frame_px[::-1])
        self._scene[self._window["scale"]] = [*((columns, rows) / frame_px), 1.0]
        self._scene[self._window["offset"]] = [*(-margin_px / frame_px), 0.0]
        read_again(self._scene)

    def brightest(self, wavelengths_nm):
        """The largest brightness, at strength 1, of the lamps that share the flat lamp's group: the brightest lamp's
        mean over the wavelengths of the pass. At least 1, the brightness of all other lamps."""
        flat = self._lamps.flat.density_at(wavelengths_nm)
        levels = (self._lamps.shared_density_at(lamp, wavelengths_nm) / flat for lamp in self._sharing)
        return max([1.0, *(float(level.mean()) for level in levels)])

    def emission_at(self, block, wavelengths_nm):
        """Spectral emission of a substituted material, lamp or world, towards the camera: array (wavelength,), without
        negative light. For a material and a world it is radiance; for a lamp, it is relative to its power. None if
        nodes compute it.

        Parameters
        ----------
        block : bpy.types.Material, Light or World
        wavelengths_nm : float64 array (wavelength,)
            Of the picture.
        """
        output, total = cycles_output(block), np.zeros(len(wavelengths_nm))
        for node, groups, share in shared_closures(output.inputs["Surface"]) if output else ():
            for names in EMISSIONS:
                colour, strength = (node.inputs.get(name) for name in names)
                if colour is None or strength is None:
                    continue
                watts, values = constant_of(strength, groups), self._emission_values(colour, groups, wavelengths_nm)
                if watts is None or (values is None and watts):
                    return None
                if watts:
                    total += share * watts * values
        return np.maximum(total, 0)

    def _emission_values(self, socket, groups, wavelengths_nm):
        """The values of a substituted emission colour at the picture's wavelengths; None if nodes compute them."""
        source = source_of(socket, groups)[0]
        name = source and property_of(source.node)
        if name not in self._group_of:
            return None
        return self._values[name](wavelengths_nm) * self._group_of[name].output_at(wavelengths_nm)

    def _substitute_material(self, material):
        assigned = self._assigned(material, reflectance=self._spectra.of(material, "reflectance"),
                                  refraction=self._spectra.of(material, "refraction"),
                                  emission=self._lamps.assigned(material))
        stand_in = self._stand_in(material)
        self.materials[stand_in.name] = material.name
        if not uses_nodes(material):
            single_shader(stand_in, "ShaderNodeBsdfDiffuse", "ShaderNodeOutputMaterial", material.diffuse_color)
        self._substitute_tree(stand_in.node_tree, assigned)

    def _substitute_light(self, light):
        emission = self._lamps.assigned(light)
        lamp = self._lamps.blackbody(light.temperature) if light.use_temperature and not emission else None
        tint = (1.0, 1.0, 1.0) if emission else tuple(light.color)
        if lamp and light.lensfield.power_unit == "BLENDER":
            tint = tuple(self._gain_to_white(lamp) * value for value in tint)
        assigned = self._assigned(light, emission=emission, lamp=lamp, tint=tint)
        stand_in = self._stand_in(light)
        if not uses_nodes(light):
            single_shader(stand_in, "ShaderNodeEmission", "ShaderNodeOutputLight", (1, 1, 1, 1))
        stand_in.color = (1, 1, 1)
        stand_in.use_temperature = False
        if light.lensfield.power_unit == "LUMEN":
            if not any(tint):
                raise SceneError(f"light {light.name!r}", "color", "black",
                                 "choose another colour: black emits no lumens")
            give_lumens(stand_in, light.lensfield.lumens, emission or lamp or self._lamps.daylight, tint)
        self._substitute_tree(stand_in.node_tree, assigned)

    def _substitute_world(self, world):
        assigned = self._assigned(world, emission=self._lamps.assigned(world))
        stand_in = self._stand_in(world)
        if not uses_nodes(world):
            single_shader(stand_in, "ShaderNodeBackground", "ShaderNodeOutputWorld", (*world.color, 1))
        self._substitute_tree(stand_in.node_tree, assigned)
        self._hold_constant(stand_in.node_tree, {})

    def _assigned(self, data_block, **fields):
        return Assigned(**fields, shared_group=self._groups.is_shared(data_block))

    def _stand_in(self, original):
        stand_in = self._journal.stand_in(original)
        stand_in.animation_data_clear()  # the copy has this frame's values; animation would overwrite the new ones
        if stand_in.node_tree:
            stand_in.node_tree.animation_data_clear()
        return stand_in

    def _substitute_tree(self, tree, assigned):
        """Wire the inputs of every shader node of a tree, and of the groups in it."""
        for window in list(window_outputs(tree.nodes)):
            self._move_window(tree, window)
        for socket in [socket for node in tree.nodes for socket in node.inputs]:
            if colour := glowing_colour(socket):
                emission_between(tree, colour, socket)
        for node in list(tree.nodes):
            if node.bl_idname == "ShaderNodeGroup" and node.node_tree:
                node.node_tree = self._substituted_group(node.node_tree, assigned)
            elif is_shader(node):
                for socket in node.inputs:
                    source = self._source(tree, node, socket, assigned)
                    if source:
                        tree.links.new(source, socket)

    def _move_window(self, tree, window):
        """Insert the scale and offset of `place_window` behind an output of Window coordinates."""
        takers = [link.to_socket for link in window.links if not link.is_muted]
        self._window = self._window or {"scale": self._free_property(), "offset": self._free_property()}
        placed = tree.nodes.new("ShaderNodeVectorMath")
        placed.operation = "MULTIPLY_ADD"
        tree.links.new(window, placed.inputs[0])
        for name, socket in zip(("scale", "offset"), placed.inputs[1:], strict=False):
            tree.links.new(attribute_node(tree, self._window[name]).outputs["Vector"], socket)
        for taker in takers:
            tree.links.new(placed.outputs[0], taker)

    def _substituted_group(self, group, assigned):
        key = group.session_uid, assigned
        if key not in self._copies:
            copy = self._copies[key] = self._copied_group(group)
            self._copies[copy.session_uid, assigned] = copy
            copy.animation_data_clear()
            self._substitute_tree(copy, assigned)
        return self._copies[key]

    def _hold_constant(self, tree, copies):
        """Replace the Attribute nodes of a substituted tree by constants, also in copies of the groups in it."""
        for node in list(tree.nodes):
            if node.bl_idname == "ShaderNodeGroup" and node.node_tree:
                if (key := node.node_tree.session_uid) not in copies:
                    copies[key] = self._copied_group(node.node_tree)
                    self._hold_constant(copies[key], copies)
                node.node_tree = copies[key]
            elif node.bl_idname == "ShaderNodeAttribute" and node.attribute_name in self._values:
                self._constants.append((node.attribute_name, constant_instead(tree, node)))

    def _copied_group(self, group):
        copy = group.copy()
        self._journal.on_exit(lambda: bpy.data.node_groups.remove(copy))
        return copy

    def _source(self, tree, node, socket, assigned):
        """The output to link to an input, or None to leave the input unchanged."""
        how = None if is_idle(node, socket, constant_of) else kind(node, socket)
        if how == EMISSION:
            return self._emission(tree, socket, assigned)
        if how == INDEX:
            glass = assigned.refraction is not None and not assigned.metal
            return self._index(tree, assigned.refraction) if glass else None
        if how == REFLECTANCE and takes_reflectance(node, socket):
            if assigned.reflectance or assigned.metal:
                reflectance_at = assigned.reflectance.at if assigned.reflectance else assigned.refraction.reflectance_at
                return self._factor(tree, reflectance_at)
        if how == CHANNELS and assigned.metal and socket.name in ("IOR", "Extinction"):
            self.factors.append(assigned.refraction.reflectance_at)
            refraction = assigned.refraction
            return self._attribute(tree, refraction.n_at if socket.name == "IOR" else refraction.k_at)
        return self._colour(tree, socket, how) if how else None

    def _colour(self, tree, socket, how):
        """The user's colour, upsampled: a constant as an attribute, a computed colour by nodes."""
        basis, constant = BASIS[how], constant_of(socket)
        if constant is None:
            self.mixed_colours = True
            return self._upsampled(tree, basis, feeding(socket))
        colour = np.array(constant[:3])
        if how != CHANNELS:
            return self._factor(tree, lambda nm: np.maximum(basis(nm) @ colour, 0))
        self.factors.append(lambda nm: np.exp(-(basis(nm) @ colour) / max(colour.max(), 1e-9)))  # like an absorber's
        return self._attribute(tree, lambda nm: basis(nm) @ colour)

    def _emission(self, tree, socket, assigned):
        """The output for an emitting input: its colour times its lamp, relative to the lamp of its light group."""
        temperature_k = None if assigned.emission or assigned.lamp else blackbody_temperature(socket)
        lamp = assigned.emission or assigned.lamp or self._lamps.of_socket(socket)
        group = self._lamps.flat if assigned.shared_group else lamp
        if group is not lamp:
            self._sharing.add(lamp)
        tint = np.array(assigned.tint)

        def light_at(nm):
            relative = 1.0 if group is lamp else self._lamps.shared_density_at(lamp, nm) / group.density_at(nm)
            return relative * np.maximum(colour_basis(nm) @ tint, 0)

        if assigned.emission:
            return self._glow(tree, light_at, group, socket)
        if temperature_k:
            gain = self._gain_to_white(lamp)
            return self._glow(tree, lambda nm: gain * light_at(nm), group, socket)
        constant = constant_of(socket)
        if constant is None:
            self.mixed_colours = True
            colour = self._upsampled(tree, colour_basis, feeding(socket))
            unchanged = group is lamp and np.all(tint == 1)
            return colour if unchanged else multiplied(tree, colour, self._glow(tree, light_at, group))
        colour = np.array(constant[:3])
        return self._glow(tree, lambda nm: light_at(nm) * np.maximum(colour_basis(nm) @ colour, 0), group, socket)

    def _gain_to_white(self, lamp):
        """The factor for the luminance of white light of the same watts, which Blender gives to a temperature."""
        return luminous_efficacy(self._lamps.daylight) / luminous_efficacy(lamp)

    def _index(self, tree, refraction):
        node = attribute_node(tree, self._property(refraction.n_at))
        self._indices.add(node.attribute_name)
        return node.outputs["Fac"]

    def _factor(self, tree, values_at):
        """An attribute that multiplies light on its way."""
        self.factors.append(values_at)
        return self._attribute(tree, values_at)

    def _glow(self, tree, values_at, group, socket=None):
        """An attribute for emission in the light group of a lamp, added to the factors with a peak of 1: only its shape
        decides how many wavelengths are needed.

        Cycles estimates emissions from constants, and builds its light tree by these estimates. As passes share their
        noise, the tree must not depend on their wavelengths: Cycles does not know the attribute for a `socket` of the
        ESTIMATED nodes in advance.
        """
        values = values_at(np.arange(BAND_NM[0], BAND_NM[1] + 1))
        if (peak := values.max()) > 0:
            self.factors.append(lambda nm: values_at(nm) / peak)
        estimated = socket is not None and socket.node.bl_idname in ESTIMATED
        factor = _move_into_strength(socket, values) if estimated else 1.0
        node = attribute_node(tree, self._property(lambda nm: values_at(nm) / factor))
        self._group_of[node.attribute_name] = group
        return unfolded(tree, node) if estimated else node.outputs["Color"]

    def _attribute(self, tree, values_at):
        """Output of a new node with the values of `values_at` at the wavelengths of the pass."""
        return attribute_node(tree, self._property(values_at)).outputs["Color"]

    def _property(self, values_at):
        name = self._free_property()
        self._values[name] = values_at
        return name

    def _free_property(self):
        """The name of a new property of the scene: three numbers, removed at the end."""
        index = len(self._values)
        while (name := f"{PROPERTY_PREFIX}{index}") in self._scene:  # one of the user's properties
            index += 1
        self._scene[name] = [0.0, 0.0, 0.0]
        self._journal.on_exit(lambda: self._scene.pop(name, None))
        return name

    def _upsampled(self, tree, basis, colour):
        node = tree.nodes.new("ShaderNodeGroup")
        node.node_tree = self._upsamplers[basis]
        tree.links.new(colour, node.inputs[0])
        return node.outputs[0]

    def _make_upsampler(self, basis):
        rows = [self._property(lambda nm, channel=channel: basis(nm)[channel]) for channel in range(3)]
        group = upsampler(f"{PROPERTY_PREFIX}{basis.__name__}", rows)
        self._journal.on_exit(lambda: bpy.data.node_groups.remove(group))
        return group
