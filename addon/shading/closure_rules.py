"""Rules for the shader nodes that output a closure: the sockets where Cycles mixes wavelengths.

Cycles works in red, green and blue, and nearly always on each separately, so that each may carry a wavelength. The
exceptions listed here come from Cycles' kernel (Blender 5.0) and from its renders, comparing three wavelengths in one
pass with one wavelength per pass.
"""

from .node_rules import APPROXIMATED, NO_EFFECT, REJECTED, SEPARATED, UNKNOWN

THINNEST_FILM_NM = 0.1  # below it Cycles leaves the film out

CLOSURES = {f"ShaderNode{name}" for name in (
    "AddShader MixShader Background Emission Holdout BsdfAnisotropic BsdfDiffuse BsdfGlass BsdfGlossy BsdfHair "
    "BsdfHairPrincipled BsdfMetallic BsdfPrincipled BsdfRayPortal BsdfRefraction BsdfSheen BsdfToon BsdfTranslucent "
    "BsdfTransparent BsdfVelvet SubsurfaceScattering VolumeAbsorption VolumeCoefficients VolumePrincipled "
    "VolumeScatter").split()}
NOT_IN_CYCLES = {"ShaderNodeEeveeSpecular"}
"""Closures that Cycles does not support and renders black."""

THIN_FILM = "Cycles gives thin films fixed curves for red, green and blue at every wavelength: set the thickness to 0"
TINT = ("coloured: at every wavelength of a pass, the layers below lose the most that the tint reflects at any; a "
        "saturated tint takes")
SPECULAR_TINT = f"{TINT} 4 % from the other wavelengths at an IOR of 1.5, 17 % at 2.5"
SHEEN_TINT = (f"{TINT} 2 to 20 % from the other wavelengths at a sheen roughness of 0.5, 34 to 50 % at 1, most at "
              "grazing angles")
MELANIN = "melanin absorbs by fixed values for red, green and blue: choose Direct Coloring or Absorption Coefficient"
FIRE = ("the blackbody of a volume is RGB at every wavelength: set its intensity to 0, and use Emission Strength "
        "with an assigned emission")
VOLUME_COLOUR = "multiplies every wavelength by an attribute's RGB: clear it, and link an Attribute node to Color"
INDICES = ("values for red, green and blue, linearly interpolated: gold's reflectance is off by -0.05 to +0.08; "
           "assign a metal's refraction")
LENGTHS = "values for red, green and blue, linearly interpolated, and constant beyond: the scene contains no more data"


def closure_findings(node, value_of):
    """Findings about a closure node, in addition to the conversion of its colours to spectra.

    Parameters
    ----------
    node : bpy.types.ShaderNode
    value_of : callable (socket) -> number or tuple, or None for values computed by nodes

    Returns
    -------
    generator of (socket or None, verdict, text); None means the complete node
    """
    if node.bl_idname in NOT_IN_CYCLES:
        yield None, REJECTED, NO_EFFECT
    elif node.bl_idname not in CLOSURES:
        yield None, REJECTED, UNKNOWN
    else:
        yield from _thin_film(node, value_of)
        yield from _OF_NODE.get(node.bl_idname, _nothing)(node, value_of)


def channels_finding(socket, value):
    """The finding about three constants for red, green and blue: (verdict, text), or None if they are equal."""
    if max(value) - min(value) <= 1e-6 * max(map(abs, value)):
        return None
    return APPROXIMATED, INDICES if socket.name in ("IOR", "Extinction") else LENGTHS


def is_idle(node, socket, value_of):
    """Whether a spectral input does not affect its node."""
    weight = {"Subsurface Radius": "Subsurface Weight", "Sheen Tint": "Sheen Weight", "Coat Tint": "Coat Weight",
              "Emission Color": "Emission Strength", "Blackbody Tint": "Blackbody Intensity",
              "Color": "Strength"}.get(socket.name)
    if not socket.enabled:
        return True
    return weight is not None and weight in node.inputs and value_of(node.inputs[weight]) == 0


def _nothing(node, value_of):
    return ()


def _thin_film(node, value_of):
    socket = node.inputs.get("Thin Film Thickness")
    if socket is not None and socket.enabled:
        thickness_nm = value_of(socket)
        if thickness_nm is None or thickness_nm > THINNEST_FILM_NM:
            yield socket, REJECTED, THIN_FILM


def _principled(node, value_of):
    def value(name):
        return value_of(node.inputs[name])

    covered = value("Metallic") == 1 or value("Transmission Weight") == 1
    reflects = value("Specular IOR Level") != 0 and value("IOR") != 1
    if reflects and not covered and _coloured(value("Specular Tint")):
        yield node.inputs["Specular Tint"], SEPARATED, SPECULAR_TINT
    if value("Sheen Weight") != 0 and _coloured(value("Sheen Tint")):
        yield node.inputs["Sheen Tint"], SEPARATED, SHEEN_TINT


def _coloured(value):
    return value is None or max(value[:3]) - min(value[:3]) > 1e-5


def _hair(node, value_of):
    if node.parametrization == "MELANIN":
        yield node.inputs["Melanin"], REJECTED, MELANIN


def _volume(node, value_of):
    if value_of(node.inputs["Blackbody Intensity"]) != 0:
        yield node.inputs["Blackbody Intensity"], REJECTED, FIRE
    if node.inputs["Color Attribute"].default_value:
        yield node.inputs["Color Attribute"], REJECTED, VOLUME_COLOUR


_OF_NODE = {"ShaderNodeBsdfPrincipled": _principled, "ShaderNodeBsdfHairPrincipled": _hair,
            "ShaderNodeVolumePrincipled": _volume}
