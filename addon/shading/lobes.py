"""How a material treats a camera ray: the shares that continue straight, are refracted or mirrored, and their
roughness; and whether a volume emits or scatters. Only constants count, as values computed by nodes are unknown."""

from dataclasses import dataclass

import bpy

from ..scene.instances import cycles_output
from .node_paths import constant_of, source_of
from .node_rules import FLOW
from .spectral_sockets import is_shader

STRAIGHT, REFRACTED, MIRRORED = "straight", "refracted", "mirrored"
SMOOTH, ROUGH = 0.0, 1.0
HEAD_ON = 0.04  # output of Fresnel and Layer Weight nodes for a surface that faces the camera
UNKNOWN_MIX = 0.5
ABSORBING = {"ShaderNodeVolumeAbsorption"}
EMISSIONS = (("Color", "Strength"), ("Emission Color", "Emission Strength"), ("Blackbody Tint", "Blackbody Intensity"))
AMOUNTS = "Density", "Strength", "Emission Strength", "Blackbody Intensity"
SEEN_BY_CAMERA = {"Is Camera Ray": 1.0}  # Light Path outputs; all others are 0, counters such as Ray Depth too


@dataclass(frozen=True)
class Lobe:
    """A part of the light that comes from a surface.

    Attributes
    ----------
    way : str
        STRAIGHT, REFRACTED or MIRRORED.
    share : float
        0 to 1.
    roughness : float
        The node's Roughness.
    """

    way: str
    share: float
    roughness: float = SMOOTH


def lobes_of(material):
    """The Lobes of a material's surface: list. Scattered light is not included."""
    output = cycles_output(material)
    return list(_surface(output.inputs["Surface"], (), 1.0)) if output else []


def has_surface(material):
    """Whether a material has a surface shader, and not only a volume."""
    output = cycles_output(material)
    return output is None or source_of(output.inputs["Surface"])[0] is not None


def glows_within(block):
    """Whether the volume of a material or world emits or scatters light, and does not only absorb it."""
    output = cycles_output(block)
    return bool(output) and any(node.bl_idname not in ABSORBING and not _is_empty(node, groups)
                                for node, groups in closures(output.inputs["Volume"], ()))


def shines(block):
    """Whether a material, lamp or world emits light; values computed by nodes count as emission."""
    if isinstance(block, bpy.types.Light) and block.lensfield.power_unit != "LUMEN" and not block.energy:
        return False
    spectrum = bool(block.lensfield.emission.strip())
    output = cycles_output(block)
    if output is None:
        return not isinstance(block, bpy.types.Material) and (spectrum or any(block.color[:3]))
    return any(_emits(node, groups, spectrum) for name in ("Surface", "Volume") if name in output.inputs
               for node, groups in closures(output.inputs[name], ()))


def _emits(node, groups, spectrum):
    """Whether a closure emits, by its constants; if a spectrum is assigned, it replaces the colours."""
    if not is_shader(node):
        return True  # Cycles turns a colour in place of a shader into emission
    for colour, strength in EMISSIONS:
        values = [constant_of(node.inputs[name], groups) for name in (colour, strength) if name in node.inputs]
        if len(values) == 2 and values[1] != 0 and (spectrum or values[0] is None or any(values[0][:3])):
            return True
    coefficients = node.inputs.get("Emission Coefficients")
    return coefficients is not None and any(constant_of(coefficients, groups) or (1.0,))


def _surface(socket, groups, share):
    """The Lobes of the shader linked to an input that receives this share of the light."""
    for node, inside, part in shared_closures(socket, groups, share):
        if node.bl_idname in _LOBES:
            yield from _LOBES[node.bl_idname](node, inside, part)


def shared_closures(socket, groups=(), share=1.0):
    """(node, its groups, its share) of the closures linked to a shader input, mixed as for a camera ray."""
    source, groups, _ = source_of(socket, groups)
    if source is None or share <= 0:
        return
    node = source.node
    if node.bl_idname == "ShaderNodeMixShader":
        factor = _mix(node.inputs[0], groups)
        yield from shared_closures(node.inputs[1], groups, share * (1 - factor))
        yield from shared_closures(node.inputs[2], groups, share * factor)
    elif node.bl_idname == "ShaderNodeAddShader":
        for each in node.inputs:
            yield from shared_closures(each, groups, share)
    else:
        yield node, groups, share


def _mix(socket, groups):
    """A mix factor for a camera ray."""
    source = source_of(socket, groups)[0]
    if source is not None and source.node.bl_idname == "ShaderNodeLightPath":
        return SEEN_BY_CAMERA.get(source.name, 0.0)
    if source is not None and source.node.bl_idname in ("ShaderNodeFresnel", "ShaderNodeLayerWeight"):
        return HEAD_ON
    factor = constant_of(socket, groups)
    return UNKNOWN_MIX if factor is None else min(max(factor, 0.0), 1.0)


def _value(node, name, groups, unknown):
    value = constant_of(node.inputs[name], groups)
    return unknown if value is None else value


def _straight(node, groups, share):
    yield Lobe(STRAIGHT, share)


def _refracted(node, groups, share):
    yield Lobe(REFRACTED, share, _value(node, "Roughness", groups, SMOOTH))


def _mirrored(node, groups, share):
    yield Lobe(MIRRORED, share, _value(node, "Roughness", groups, ROUGH))


def _principled(node, groups, share):
    alpha = _value(node, "Alpha", groups, 1.0)
    metallic = _value(node, "Metallic", groups, UNKNOWN_MIX)
    transmitted = _value(node, "Transmission Weight", groups, UNKNOWN_MIX)
    yield Lobe(STRAIGHT, share * (1 - alpha))
    yield from _mirrored(node, groups, share * alpha * metallic)
    yield from _refracted(node, groups, share * alpha * (1 - metallic) * transmitted)


_LOBES = {"ShaderNodeBsdfTransparent": _straight, "ShaderNodeBsdfGlass": _refracted,
          "ShaderNodeBsdfRefraction": _refracted, "ShaderNodeBsdfAnisotropic": _mirrored,
          "ShaderNodeBsdfGlossy": _mirrored, "ShaderNodeBsdfMetallic": _mirrored,
          "ShaderNodeBsdfPrincipled": _principled}


def closures(socket, groups):
    """(node, its groups) of the closures linked to a shader input."""
    source, groups, _ = source_of(socket, groups)
    if source is None:
        return
    if source.node.bl_idname in {"ShaderNodeMixShader", "ShaderNodeAddShader"} | FLOW:
        for each in source.node.inputs:
            if each.type == "SHADER":
                yield from closures(each, groups)
    else:
        yield source.node, groups


def _is_empty(node, groups):
    """Whether a volume's density and emission are all 0, by its constants."""
    amounts = [constant_of(node.inputs[name], groups) for name in AMOUNTS if name in node.inputs]
    return bool(amounts) and all(amount == 0 for amount in amounts)
