"""The inputs of shader nodes that vary with wavelength, and how, for substitution and the linter."""

REFLECTANCE, EMISSION, CHANNELS, INDEX = "reflectance", "emission", "channels", "index"

EMITTING_NODES = {"ShaderNodeEmission", "ShaderNodeBackground"}
EMITTING_SOCKETS = {"Emission Color", "Emission", "Blackbody Tint", "Emission Coefficients"}
CHANNEL_SOCKETS = {"Radius", "Subsurface Radius", "IOR", "Extinction", "Absorption Coefficient",
                   "Absorption Coefficients", "Scatter Coefficients"}
"""Vectors of one value each for red, green and blue that are not colours."""
BASE_COLOUR_SOCKETS = {"Base Color", "Color"}
NOT_REFLECTING = {"ShaderNodeBsdfTransparent", "ShaderNodeVolumeAbsorption", "ShaderNodeVolumeScatter",
                  "ShaderNodeVolumePrincipled"}
REFRACTING_NODES = {"ShaderNodeBsdfPrincipled", "ShaderNodeBsdfGlass", "ShaderNodeBsdfRefraction"}


def is_shader(node):
    """Whether a node outputs a closure rather than a value."""
    return any(output.type == "SHADER" for output in node.outputs)


def kind(node, socket):
    """How a shader node's input varies with wavelength, or None if it does not.

    INDEX is a refractive index: a single number that varies with wavelength only if a glass is assigned.
    """
    if socket.name in EMITTING_SOCKETS or (socket.type == "RGBA" and node.bl_idname in EMITTING_NODES):
        return EMISSION if socket.type in ("RGBA", "VECTOR") else None
    if socket.type == "RGBA":
        return REFLECTANCE
    if socket.type == "VECTOR" and socket.name in CHANNEL_SOCKETS:
        return CHANNELS
    return INDEX if socket.name == "IOR" and node.bl_idname in REFRACTING_NODES else None


def takes_reflectance(node, socket):
    """Whether a material's assigned reflectance replaces this socket's colour."""
    return socket.name in BASE_COLOUR_SOCKETS and node.bl_idname not in NOT_REFLECTING
