"""What a camera's ray meets at a material: what of its light goes straight on, is refracted, or mirrored, and how
smoothly; and whether a volume shines or scatters. By its constants: what nodes compute is not known."""

from dataclasses import dataclass

from ..scene.instances import cycles_output
from .node_paths import constant_of, source_of
from .node_rules import FLOW

STRAIGHT, REFRACTED, MIRRORED = "straight", "refracted", "mirrored"
SMOOTH, ROUGH = 0.0, 1.0
HEAD_ON = 0.04  # of Fresnel and Layer Weight nodes, of what faces the camera
UNKNOWN_MIX = 0.5
ABSORBING = {"ShaderNodeVolumeAbsorption"}
AMOUNTS = "Density", "Strength", "Emission Strength", "Blackbody Intensity"
SEEN_BY_CAMERA = {"Is Camera Ray": 1.0}  # of a Light Path's outputs; those that count, such as Ray Depth, are 0, too


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
        As the node has it.
    """

    way: str
    share: float
    roughness: float = SMOOTH


def lobes_of(material):
    """The Lobes of a material's surface: list; what it scatters is in none."""
    output = cycles_output(material)
    return list(_surface(output.inputs["Surface"], (), 1.0)) if output else []


def has_surface(material):
    """Whether a material is more than a volume."""
    output = cycles_output(material)
    return output is None or source_of(output.inputs["Surface"])[0] is not None


def glows_within(block):
    """Whether the volume of a material or world gives light of its own: by scattering or shining, not by absorbing."""
    output = cycles_output(block)
    return bool(output) and any(node.bl_idname not in ABSORBING and not _is_empty(node, groups)
                                for node, groups in _closures(output.inputs["Volume"], ()))


def _surface(socket, groups, share):
    """The Lobes of what is linked into a shader's input, for so much of all light."""
    source, groups, _ = source_of(socket, groups)
    if source is None or share <= 0:
        return
    node = source.node
    if node.bl_idname == "ShaderNodeMixShader":
        factor = _mix(node.inputs[0], groups)
        yield from _surface(node.inputs[1], groups, share * (1 - factor))
        yield from _surface(node.inputs[2], groups, share * factor)
    elif node.bl_idname == "ShaderNodeAddShader":
        for each in node.inputs:
            yield from _surface(each, groups, share)
    elif node.bl_idname in _LOBES:
        yield from _LOBES[node.bl_idname](node, groups, share)


def _mix(socket, groups):
    """A mix factor, as a camera's ray has it."""
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


def _closures(socket, groups):
    """(node, its groups) of the closures that are linked into a shader's input."""
    source, groups, _ = source_of(socket, groups)
    if source is None:
        return
    if source.node.bl_idname in {"ShaderNodeMixShader", "ShaderNodeAddShader"} | FLOW:
        for each in source.node.inputs:
            if each.type == "SHADER":
                yield from _closures(each, groups)
    else:
        yield source.node, groups


def _is_empty(node, groups):
    """Whether nothing of a volume is there or shines, by its constants."""
    amounts = [constant_of(node.inputs[name], groups) for name in AMOUNTS if name in node.inputs]
    return bool(amounts) and all(amount == 0 for amount in amounts)
