"""Substitution: every colour of the scene becomes its values at the wavelengths of a pass.

Materials, lights, worlds and the node groups in them get stand-ins whose colour inputs are wired, once, to Attribute
nodes that read properties of the scene. Between passes only those properties change, so that Cycles keeps its
geometry and shaders.

A colour that is known (a constant, or an assigned spectrum) becomes one attribute. A colour that is computed by nodes
goes through a node group that upsamples it: the bases are linear, so a value at one wavelength is a dot product with
the colour. What shines does so in its own colour under the white light of its group; lamps' spectra come in later.
Where a basis takes a colour outside Rec. 709 below 0, it is cut there: nothing reflects or emits less than nothing.
"""

from contextlib import suppress
from dataclasses import dataclass

import bpy
import numpy as np

from ...engine.spectral.refraction import D_LINE_NM, Refraction
from ...engine.spectral.spectra import BAND_NM, Spectrum, channel_basis
from ..scene.errors import SceneError
from ..scene.instances import uses_nodes
from ..scene.render_state import rendered_layer
from ..scene.working_space import colour_basis
from .closure_rules import is_idle
from .lamps import Lamp, blackbody_temperature
from .lumens import give_lumens, luminous_efficacy
from .node_paths import constant_of, feeding, glowing_colour
from .spectral_sockets import CHANNELS, EMISSION, INDEX, REFLECTANCE, is_shader, kind, takes_reflectance
from .wiring import attribute_node, emission_between, multiplied, single_shader, upsampler

PROPERTY_PREFIX = "lensfield_"
BASIS = {REFLECTANCE: colour_basis, EMISSION: colour_basis, CHANNELS: channel_basis}


@dataclass(frozen=True)
class Assigned:
    """What the user gave a data-block, and the light in which it shines.

    Attributes
    ----------
    reflectance : Spectrum or None
    refraction : Refraction or None
    emission : Lamp or None
        In place of the colours of all that it emits.
    lamp : Lamp or None
        What its colours are seen by as it emits; None where each input has its own.
    tint : (float, float, float)
        Colour of all that it emits, in the working space.
    shared_group : bool
        Whether it shines in a light group of several spectra.
    """

    reflectance: Spectrum | None = None
    refraction: Refraction | None = None
    emission: Lamp | None = None
    lamp: Lamp | None = None
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0)
    shared_group: bool = False

    @property
    def metal(self):
        """Whether the refraction is that of a metal."""
        return self.refraction is not None and self.refraction.metal


class Substitution:
    """Wires a scene for spectral passes; undone by the journal.

    Parameters
    ----------
    scene : bpy.types.Scene
    journal : Journal
    spectra : AssignedSpectra
    lamps : Lamps
    groups : LightGroups
    rendered : collection of materials, lights and worlds
        Those that reach the render. The others are substituted too, but do not count.

    Attributes
    ----------
    factors : list of callable (wavelengths_nm) -> values
        What light is multiplied by on its way: the reflectances and colours that are known.
    mixed_colours : bool
        Whether other colours are computed by nodes.
    refusals : list of SceneError
        Of those rendered, why they cannot be substituted.
    """

    def __init__(self, scene, journal, spectra, lamps, groups, rendered):
        self._scene, self._journal = scene, journal
        self._spectra, self._lamps, self._groups = spectra, lamps, groups
        self._values, self._indices, self._copies, self._sharing = {}, set(), {}, set()
        self.factors, self.mixed_colours, self.refusals = [], False, []
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
                with suppress(SceneError):  # nothing of it is seen
                    substitute(block)
        self.factors, self.mixed_colours = counted

    def set_wavelengths(self, wavelengths_nm, dispersive=False):
        """Give every attribute its values at these three wavelengths; glass its index there only where it disperses."""
        for name, values_at in self._values.items():
            # without dispersion the index of the D line stands for all
            at_nm = np.full(3, D_LINE_NM) if name in self._indices and not dispersive else wavelengths_nm
            self._scene[name] = [float(value) for value in values_at(at_nm)]
        # Persistent data would keep the values of the first pass. Tagging the scene would have its meshes synchronised
        # again; a property of the view layer, though set to what it is, has just the attributes read anew.
        layer = rendered_layer(self._scene)
        layer.samples = layer.samples

    def brightest(self, wavelengths_nm):
        """How bright lamps that share the flat one's group get in a pass, of strength 1: the brightest's mean over its
        wavelengths, and 1 at the least, which is what all others have."""
        flat = self._lamps.flat.density_at(wavelengths_nm)
        levels = (self._lamps.shared_density_at(lamp, wavelengths_nm) / flat for lamp in self._sharing)
        return max([1.0, *(float(level.mean()) for level in levels)])

    def _substitute_material(self, material):
        assigned = self._assigned(material, reflectance=self._spectra.of(material, "reflectance"),
                                  refraction=self._spectra.of(material, "refraction"),
                                  emission=self._lamps.assigned(material))
        stand_in = self._stand_in(material)
        if not uses_nodes(material):
            single_shader(stand_in, "ShaderNodeBsdfDiffuse", "ShaderNodeOutputMaterial", material.diffuse_color)
        self._substitute_tree(stand_in.node_tree, assigned)

    def _substitute_light(self, light):
        emission = self._lamps.assigned(light)
        lamp = self._lamps.blackbody(light.temperature) if light.use_temperature and not emission else None
        tint = (1.0, 1.0, 1.0) if emission else tuple(light.color)
        assigned = self._assigned(light, emission=emission, lamp=lamp, tint=tint)
        stand_in = self._stand_in(light)
        if not uses_nodes(light):
            single_shader(stand_in, "ShaderNodeEmission", "ShaderNodeOutputLight", (1, 1, 1, 1))
        stand_in.color = (1, 1, 1)
        stand_in.use_temperature = False
        if light.lensfield.power_unit == "LUMEN":
            if not any(tint):
                raise SceneError(f"light {light.name!r}", "color", "black", "no lumens come of it: choose another")
            give_lumens(stand_in, light.lensfield.lumens, emission or lamp or self._lamps.daylight, tint)
        self._substitute_tree(stand_in.node_tree, assigned)

    def _substitute_world(self, world):
        assigned = self._assigned(world, emission=self._lamps.assigned(world))
        stand_in = self._stand_in(world)
        if not uses_nodes(world):
            single_shader(stand_in, "ShaderNodeBackground", "ShaderNodeOutputWorld", (*world.color, 1))
        self._substitute_tree(stand_in.node_tree, assigned)

    def _assigned(self, data_block, **fields):
        return Assigned(**fields, shared_group=self._groups.is_shared(data_block))

    def _stand_in(self, original):
        stand_in = self._journal.stand_in(original)
        stand_in.animation_data_clear()  # it holds this frame's values; animation would overwrite what is set here
        if stand_in.node_tree:
            stand_in.node_tree.animation_data_clear()
        return stand_in

    def _substitute_tree(self, tree, assigned):
        """Wire the inputs of every shader node of a tree, and of the groups in it."""
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

    def _substituted_group(self, group, assigned):
        key = group.session_uid, assigned
        if key not in self._copies:
            copy = self._copies[key] = group.copy()
            self._copies[copy.session_uid, assigned] = copy
            self._journal.on_exit(lambda: bpy.data.node_groups.remove(copy))
            copy.animation_data_clear()
            self._substitute_tree(copy, assigned)
        return self._copies[key]

    def _source(self, tree, node, socket, assigned):
        """The output that an input is to take its values from, or None where it stays as it is."""
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
        """A colour of the user's own: upsampled, by nodes where only nodes know it."""
        basis, constant = BASIS[how], constant_of(socket)
        if constant is None:
            self.mixed_colours = True
            return self._upsampled(tree, basis, feeding(socket))
        colour = np.array(constant[:3])
        if how != CHANNELS:
            return self._factor(tree, lambda nm: np.maximum(basis(nm) @ colour, 0))
        self.factors.append(lambda nm: np.exp(-(basis(nm) @ colour) / max(colour.max(), 1e-9)))  # as of an absorber
        return self._attribute(tree, lambda nm: basis(nm) @ colour)

    def _emission(self, tree, socket, assigned):
        """What shines: its colour in the light of its lamp, relative to the lamp of the group it is rendered in."""
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
            return self._glow(tree, light_at)
        if temperature_k:  # Blender gives it the luminance of white
            gain = luminous_efficacy(self._lamps.daylight) / luminous_efficacy(lamp)
            return self._glow(tree, lambda nm: gain * light_at(nm))
        constant = constant_of(socket)
        if constant is None:
            self.mixed_colours = True
            colour = self._upsampled(tree, colour_basis, feeding(socket))
            own = group is lamp and np.all(tint == 1)
            return colour if own else multiplied(tree, colour, self._glow(tree, light_at))
        colour = np.array(constant[:3])
        return self._glow(tree, lambda nm: light_at(nm) * np.maximum(colour_basis(nm) @ colour, 0))

    def _index(self, tree, refraction):
        node = attribute_node(tree, self._property(refraction.n_at))
        self._indices.add(node.attribute_name)
        return node.outputs["Fac"]

    def _factor(self, tree, values_at):
        """An attribute that multiplies light on its way."""
        self.factors.append(values_at)
        return self._attribute(tree, values_at)

    def _glow(self, tree, values_at):
        """An attribute that light starts with: however strong, its shape alone says how many wavelengths it takes."""
        peak = values_at(np.arange(BAND_NM[0], BAND_NM[1] + 1)).max()
        if peak > 0:
            self.factors.append(lambda nm: values_at(nm) / peak)
        return self._attribute(tree, values_at)

    def _attribute(self, tree, values_at):
        """Output of a node that gives `values_at(wavelengths)` for the wavelengths of the pass."""
        return attribute_node(tree, self._property(values_at)).outputs["Color"]

    def _property(self, values_at):
        index = len(self._values)
        while (name := f"{PROPERTY_PREFIX}{index}") in self._scene:  # a property of the user's own
            index += 1
        self._values[name] = values_at
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
