"""Emitters: the lamp spectra of lights, emissive materials and worlds, and the light groups for them.

Cycles renders the scene under white light, and the picture is multiplied by the spectra of the lamps afterwards, so
that even spiky lamps do not cost additional passes. This needs a light group for each spectrum. An emitter with
several spectra, such as an object with two emissive materials, is rendered with its spectra applied, in the group of
the flat lamp.
"""

from dataclasses import dataclass
from functools import cached_property

import bpy
import numpy as np

from lensfield.engine.spectral.spectra import BAND_NM, Spectrum, blackbody, load_spectrum

from ..scene.instances import uses_nodes
from .closure_rules import is_idle
from .node_paths import constant_of, feeding, glowing_colour
from .spectral_sockets import EMISSION, is_shader, kind

GROUP_PREFIX = "lensfield_"
SPIKE_NM, SPIKE_SHARE = 20, 0.05
MOST_GROUPS = 16  # each needs one more picture in Cycles' memory


@dataclass(frozen=True, eq=False)
class Lamp:
    """A named emission spectrum."""

    name: str
    spectrum: Spectrum

    def density_at(self, wavelengths_nm):
        """Spectral density per nm, with unit integral over BAND_NM."""
        return self.spectrum.density_at(np.asarray(wavelengths_nm, dtype=float))

    def output_at(self, wavelengths_nm):
        """Spectral density per nm for a picture at these wavelengths: band means if the spectrum is spiky."""
        if self.spiky:
            return self.spectrum.band_means(wavelengths_nm)
        return self.density_at(wavelengths_nm)

    @cached_property
    def spiky(self):
        """Whether a running mean over SPIKE_NM moves more than SPIKE_SHARE of the light."""
        values = self.spectrum.at(np.arange(*BAND_NM))
        window = np.full(SPIKE_NM + 1, 1 / (SPIKE_NM + 1))
        smooth = np.convolve(np.pad(values, SPIKE_NM // 2, mode="edge"), window, "valid")
        return bool(np.abs(values - smooth).sum() > SPIKE_SHARE * values.sum())


class Lamps:
    """The lamps of a scene; emitters with the same spectrum share one Lamp."""

    def __init__(self, spectra, output_nm):
        self._spectra, self._output_nm, self._lamps = spectra, output_nm, {}
        self.daylight = Lamp("daylight D65", load_spectrum("illuminant-d65"))
        self.flat = Lamp("several spectra", Spectrum(np.array(BAND_NM), np.ones(2)))

    def assigned(self, data_block):
        """The lamp assigned to a data-block, or None."""
        spectrum = self._spectra.of(data_block, "emission")
        return spectrum and self._lamp(spectrum, data_block.lensfield.emission.strip(), spectrum)

    def blackbody(self, temperature_k):
        """The lamp of a blackbody, by Planck's law."""
        temperature_k = round(float(temperature_k), 3)
        return self._lamp(temperature_k, f"blackbody of {temperature_k:g} K", blackbody(temperature_k))

    def _lamp(self, key, name, spectrum):
        return self._lamps.setdefault(key, Lamp(name, spectrum))

    def shared_density_at(self, lamp, wavelengths_nm):
        """Spectral density per nm of a lamp that shares its group, also between the wavelengths of the picture.

        For a spiky lamp it is interpolated linearly between `output_at` the wavelengths of the picture.
        """
        if lamp.spiky:
            return np.interp(wavelengths_nm, self._output_nm, lamp.output_at(self._output_nm))
        return lamp.density_at(wavelengths_nm)

    def of_data_block(self, data_block):
        """The lamps that a material, light or world shines with."""
        assigned = self.assigned(data_block)
        if isinstance(data_block, bpy.types.Light):
            if assigned or data_block.use_temperature:
                return {assigned or self.blackbody(data_block.temperature)}
            if not uses_nodes(data_block):
                return {self.daylight}
        elif not uses_nodes(data_block):
            return {assigned or self.daylight} if isinstance(data_block, bpy.types.World) else set()
        sockets = list(emitting_sockets(data_block.node_tree))
        return {assigned} if assigned and sockets else {self.of_socket(socket) for socket in sockets}

    def of_socket(self, socket):
        """The lamp of an emission input without an assigned spectrum."""
        temperature_k = blackbody_temperature(socket)
        return self.blackbody(temperature_k) if temperature_k else self.daylight


class LightGroups:
    """The emitters of each lamp, and so of each light group.

    Parameters
    ----------
    shining : dict from object or world to a set of data-blocks
        The possible members of a light group, with the materials, light or world that may make them emit.
    lamps : Lamps
    together : bool
        Render all emitters as one group, as denoising requires.

    Attributes
    ----------
    lamps : list of Lamp
        The first is the lamp of all light outside the light groups created by `part`.
    """

    def __init__(self, shining, lamps, together=False):
        self._flat = lamps.flat
        of_owner = {owner: {block: lamps.of_data_block(block) for block in blocks}
                    for owner, blocks in shining.items()}
        self._mixed = _mixed_blocks(of_owner)
        owners = {}
        for owner, blocks in of_owner.items():
            owner_lamps = set().union(*blocks.values())
            if owner_lamps:
                lamp = lamps.flat if self._mixed & set(blocks) else owner_lamps.pop()
                owners.setdefault(lamp, []).append(owner)
        order = sorted(owners, key=lambda lamp: (lamp is not lamps.flat, not lamp.spiky, -len(owners[lamp]), lamp.name))
        most = 1 if together else MOST_GROUPS
        if len(order) > most:
            self._merge(of_owner, owners, order[most - 1:])
            order = [lamps.flat, *(lamp for lamp in order[:most - 1] if lamp is not lamps.flat)]
        self.lamps = order or [lamps.daylight]
        self._owners = owners

    def _merge(self, of_owner, owners, merged):
        """Move the owners of these lamps to the flat lamp."""
        together = [owner for lamp in merged for owner in owners.pop(lamp)]
        owners.setdefault(self._flat, []).extend(together)
        self._mixed |= {block for owner in together for block in _glowing(of_owner[owner])}

    def is_shared(self, data_block):
        """Whether a data-block is in the group of the flat lamp, with its spectra applied to its colours."""
        return data_block in self._mixed

    def part(self, view_layer, journal):
        """Put the emitters of each lamp except the first into a light group, and return the groups' names in the order
        of the lamps."""
        names, world = [], view_layer.world_override or view_layer.id_data.world  # already the stand-in
        for lamp in self.lamps[1:]:
            name = _free_name(view_layer, len(names) + 1)
            view_layer.lightgroups.add(name=name)
            journal.on_exit(lambda name=name: view_layer.lightgroups.remove(view_layer.lightgroups[name]))
            for owner in self._owners[lamp]:
                journal.set(world if isinstance(owner, bpy.types.World) else owner, "lightgroup", name)
            names.append(name)
        return names


def _mixed_blocks(of_owner):
    """Data-blocks that light groups cannot separate: the emitters of owners with several lamps, and of all owners that
    share one of these data-blocks."""
    mixed = set()
    while True:
        owners = [blocks for blocks in of_owner.values()
                  if len(set().union(*blocks.values())) > 1 or mixed & set(blocks)]
        glowing = {block for blocks in owners for block in _glowing(blocks)}
        if glowing == mixed:
            return mixed
        mixed = glowing


def _glowing(blocks):
    """An owner's data-blocks that have a lamp; the others may be shared without effect on light groups."""
    return {block for block, lamps in blocks.items() if lamps}


def emitting_sockets(tree):
    """The inputs of a tree, and of the groups in it, that emit light."""
    for node in tree.nodes:
        if node.bl_idname == "ShaderNodeGroup" and node.node_tree:
            yield from emitting_sockets(node.node_tree)
        elif is_shader(node):
            yield from (socket for socket in node.inputs if kind(node, socket) == EMISSION and _shines(node, socket))
        yield from filter(glowing_colour, node.inputs)


def _shines(node, socket):
    colour = constant_of(socket)
    return not is_idle(node, socket, constant_of) and (colour is None or any(value > 0 for value in colour[:3]))


def blackbody_temperature(socket):
    """The constant temperature of the Blackbody node that feeds a socket, for Planck's law; None without such a node,
    or if its temperature is linked."""
    source = feeding(socket)
    if source is None or source.node.bl_idname != "ShaderNodeBlackbody" or source.node.inputs[0].is_linked:
        return None
    return source.node.inputs[0].default_value


def _free_name(view_layer, number):
    while (name := f"{GROUP_PREFIX}{number}") in view_layer.lightgroups:  # one of the user's groups
        number += 1
    return name
