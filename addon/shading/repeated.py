"""Repeated colours of a scene: colours of glass and volumes, which multiply light many times on its way.

Only constants and assigned spectra count: colours computed by nodes are unknown before the render.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lensfield.engine.spectral.repeated_colour import RepeatedColour, rec709_of
from lensfield.engine.spectral.spectra import channel_basis

from ..scene.instances import cycles_output, rendered_instances
from ..scene.volumes import has_volume
from ..scene.working_space import colour_basis
from .lobes import closures
from .node_paths import constant_of
from .spectral_sockets import takes_reflectance

CROSSED = {"ShaderNodeBsdfGlass", "ShaderNodeBsdfRefraction", "ShaderNodeBsdfTranslucent"}
STEPS = 16  # powers to examine, up to the largest
SHALLOWEST = 1 / 16  # smallest optical depth to examine, relative to the largest
GREY = 1e-3  # largest difference between red, green and blue of a grey extinction: the accuracy of upsampling
UNKNOWN_DEPTH = 4.0  # optical depth of volumes with unknown density or extent: 2 % of the light is left


@dataclass(frozen=True, eq=False)
class RepeatedIn:
    """A repeated colour, with its data-block and objects.

    Attributes
    ----------
    block_name : str
        The material or world.
    object_names : tuple of str
        The objects that have it; empty for a world.
    colour : RepeatedColour
    volume : bool
        Whether its powers are optical depths, not crossings of a surface.
    """

    block_name: str
    object_names: tuple[str, ...]
    colour: RepeatedColour
    volume: bool

    @cached_property
    def rgb_difference(self):
        """The largest CIEDE2000 difference from an RGB render, and its power (see `RepeatedColour.rgb_difference`)."""
        return self.colour.rgb_difference()

    @property
    def place(self):
        """The first object, the number of other objects, and the data-block."""
        if not self.object_names:
            return f"the world {self.block_name!r}"
        more = f" (and {len(self.object_names) - 1} more)" if len(self.object_names) > 1 else ""
        return f"{self.object_names[0]!r}{more} of {self.block_name!r}"


def repeated_colours(scene, world, spectra):
    """The repeated colours of a scene.

    Parameters
    ----------
    scene : bpy.types.Scene
        Evaluated, with the user's materials.
    world : bpy.types.World or None
        The rendered one.
    spectra : AssignedSpectra

    Returns
    -------
    list of RepeatedIn
    """
    names, extents = {}, {}
    for instance in rendered_instances(scene):
        for material in instance.materials:
            names.setdefault(material, set()).add(instance.obj.name)
            if has_volume(material):
                extents[material] = max(_extent(instance), extents.get(material, 0.0))
    colours = []
    for material, of_objects in names.items():
        extent = extents.get(material)
        place = material.name, tuple(sorted(of_objects))
        colours += [RepeatedIn(*place, colour, False) for colour in _of_surface(material, scene.cycles, spectra)]
        colours += [RepeatedIn(*place, colour, True) for colour in _of_volume(material, extent)]
    if world:
        colours += [RepeatedIn(world.name, (), colour, True) for colour in _of_volume(world, np.inf)]
    return colours


def _extent(instance):
    """The longest path through an object, in Blender units; inf for a volume grid, whose density is in its file."""
    return np.inf if instance.obj.type == "VOLUME" else float(np.linalg.norm(np.ptp(instance.box, axis=0)))


def tinting_objects(scene):
    """Names of the rendered objects whose volume or transparency tints light that passes straight through: frozenset
    of str. Colours computed by nodes count as tints."""
    tints, names = {}, set()
    for instance in rendered_instances(scene):
        for material in instance.materials - tints.keys():
            tints[material] = any(_tints(material))
        if any(tints[material] for material in instance.materials):
            names.add(instance.obj.name)
    return frozenset(names)


def _tints(material):
    """Whether each transparent or volume closure of a material tints light: generator of bool."""
    output = cycles_output(material)
    if output is None:
        return
    for node, groups in closures(output.inputs["Surface"], ()):
        if node.bl_idname == "ShaderNodeBsdfTransparent":
            colour = constant_of(node.inputs["Color"], groups)
            yield colour is None or np.ptp(colour[:3]) > 0
    for node, groups in closures(output.inputs["Volume"], ()):
        extinction = _extinction_of(node, groups)
        yield extinction is None or bool(np.ptp(extinction[1]) > GREY)


def _of_surface(material, cycles, spectra):
    """RepeatedColours of a material's transmission: powers are crossings of its surface."""
    output = cycles_output(material)
    for node, groups in closures(output.inputs["Surface"], ()) if output else ():
        principled = node.bl_idname == "ShaderNodeBsdfPrincipled"
        if principled and constant_of(node.inputs["Transmission Weight"], groups) == 0:
            continue
        clear = node.bl_idname == "ShaderNodeBsdfTransparent"
        if not (principled or clear or node.bl_idname in CROSSED):
            continue
        curve = _reflectance(node, node.inputs["Base Color" if principled else "Color"], groups,
                             spectra.of(material, "reflectance"))
        most = cycles.transparent_max_bounces if clear else min(cycles.max_bounces, cycles.transmission_bounces)
        if curve is None or most < 1:
            continue
        if principled:  # in Cycles, each of a body's two surfaces has the square root of its colour
            yield RepeatedColour(lambda nm, curve=curve: np.sqrt(curve(nm)), np.sqrt(_rgb(curve)), _crossings(most))
        else:
            yield RepeatedColour(curve, _rgb(curve), _crossings(most))


def _of_volume(block, extent):
    """RepeatedColours of a volume of this extent, in Blender units: powers are optical depths."""
    output = cycles_output(block)
    for node, groups in closures(output.inputs["Volume"], ()) if output else ():
        extinction = _extinction_of(node, groups)
        density = constant_of(node.inputs["Density"], groups) if "Density" in node.inputs else 1.0
        if extinction is None or density == 0:
            continue
        depth = UNKNOWN_DEPTH if density is None or extent == np.inf else density * extent
        at, of_rgb = extinction
        yield RepeatedColour(lambda nm, at=at: np.exp(-at(nm)), np.exp(-of_rgb), _depths(depth))


def _extinction_of(node, groups):
    """Extinction of a volume shader at density 1, by wavelength and in RGB, as Cycles computes it; None if unknown."""
    if node.bl_idname == "ShaderNodeVolumeCoefficients":
        return _coefficients(node, groups)
    return _by_colour(node, groups)


def _by_colour(node, groups):
    colour = _colour(node, "Color", groups)
    if colour is None:
        return None
    rgb = _rgb(colour)
    if node.bl_idname == "ShaderNodeVolumeAbsorption":
        return lambda nm: np.maximum(1 - colour(nm), 0), np.maximum(1 - rgb, 0)
    if node.bl_idname == "ShaderNodeVolumeScatter":
        return colour, rgb
    if node.bl_idname == "ShaderNodeVolumePrincipled":
        absorption = _colour(node, "Absorption Color", groups)
        if absorption is not None:
            return (lambda nm: _of_principled(colour(nm), absorption(nm))), _of_principled(rgb, _rgb(absorption))
    return None


def _of_principled(colour, absorption):
    return colour + np.maximum(1 - colour, 0) * np.maximum(1 - np.sqrt(absorption), 0)


def _coefficients(node, groups):
    """Extinction of Volume Coefficients, by wavelength and in RGB, or None if nodes compute it."""
    values = [constant_of(node.inputs[name], groups) for name in ("Absorption Coefficients", "Scatter Coefficients")]
    if None in values:
        return None
    rgb = np.sum(values, axis=0)
    return lambda nm: channel_basis(nm) @ rgb, rgb


def _reflectance(node, socket, groups, assigned):
    """Spectral curve of a surface's colour, or of the assigned reflectance; None if nodes compute it."""
    if assigned is not None and takes_reflectance(node, socket):
        return assigned.at
    return _colour(node, socket.name, groups)


def _colour(node, name, groups):
    """Spectral curve of a constant colour, as substituted; None without such an input, or if nodes compute it."""
    constant = constant_of(node.inputs[name], groups) if name in node.inputs else None
    return constant and (lambda nm: np.maximum(colour_basis(nm) @ np.array(constant[:3]), 0))


def _rgb(curve):
    return np.maximum(rec709_of(curve), 0)


def _depths(most):
    return most * np.geomspace(SHALLOWEST, 1, STEPS)


def _crossings(most):
    return np.unique(np.geomspace(1, most, STEPS).round())
