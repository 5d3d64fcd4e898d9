"""Rules for the shader nodes that output a value: the linter's table.

Nodes compute colours in RGB, as in any render, and Lensfield upsamples the result at the shader's input. The nodes
before it therefore never process spectra, and a number, such as a roughness or a mix factor, is the same at all
wavelengths. The spectrum that a node represents is lost, such as the spectrum of a sky or a flame.
"""

from dataclasses import dataclass

from .spectral_sockets import CHANNELS, EMISSION, REFLECTANCE

REJECTED, SEPARATED, APPROXIMATED, UPSAMPLED, SUBSTITUTED = VERDICTS = (
    "rejected", "separated", "approximated", "upsampled", "substituted")
"""Worst first. Separated nodes are correct if each wavelength is rendered separately."""

AS = {REFLECTANCE: "a reflectance", EMISSION: "light, with D65 as white",
      CHANNELS: "values for red, green and blue, linearly interpolated"}
UNKNOWN = "unknown node: Lensfield has no rule to convert its colours to spectra"
NO_EFFECT = "Cycles does not support this node and ignores it"

BLACKBODY_BIAS = ("not a constant linked directly to an emitter, so its RGB is upsampled instead of following Planck's "
                  "law: off by 24 % rms at 2856 K, 9 % at 4000 K")
SKY_BIAS = ("its RGB is upsampled as light, not by the sky's own spectrum: off from CIE daylight by 10 % rms at "
            "12000 K, 14 % at 20000 K; assign the world an emission if that matters")
WAVELENGTH_BIAS = ("its RGB becomes a broad band: at most a quarter of it is within 10 nm of the wavelength; assign "
                   "an emission such as 588:0, 589:1, 590:0")
SCRIPT_BIAS = "its colours are treated as RGB and upsampled, whatever they mean in the script"
NON_COLOUR_BIAS = ("its Non-Color values are treated as linear Rec. 709: correct for reflectance data; in an "
                   "sRGB-encoded image, 0.5 means 0.21")
WIDE_BIAS = "its colours outside Rec. 709 become negative and are clipped at 0"
WIDE_SPACES = ("ACES", "P3", "2020", "2100", "XYZ")

COLOURS = {f"ShaderNode{name}" for name in (
    "RGB TexImage TexEnvironment TexBrick TexChecker TexGabor TexGradient TexMagic TexNoise TexVoronoi TexWave "
    "TexWhiteNoise TexPointDensity MixRGB HueSaturation BrightContrast Gamma Invert RGBCurve ValToRGB RGBToBW "
    "AmbientOcclusion Attribute VertexColor ObjectInfo VolumeInfo ParticleInfo HairInfo PointInfo NewGeometry TexCoord "
    "UVMap UVAlongStroke CameraData LightPath LightFalloff TexIES Fresnel LayerWeight Wireframe Bevel Bump Normal "
    "NormalMap Tangent Value RadialTiling Displacement VectorDisplacement Squeeze Raycast").split()} | {
    "FunctionNodeInputBool", "FunctionNodeInputInt", "FunctionNodeInputMenu", "FunctionNodeInputVector",
    "GeometryNodeInputSceneTime"}
"""Nodes that output colours, or numbers and directions that become greys and false colours; only their colour inputs
are judged further."""
ARITHMETIC = {f"ShaderNode{name}" for name in (
    "Mix Math VectorMath MapRange Clamp CombineColor SeparateColor CombineRGB SeparateRGB CombineHSV SeparateHSV "
    "CombineXYZ SeparateXYZ FloatCurve VectorCurve Mapping VectorRotate VectorTransform").split()} | {
    "NodeImplicitConversion"}
"""Nodes that pass colours on through number and vector inputs, too."""
FLOW = {"GeometryNodeMenuSwitch", "GeometryNodeRepeatInput", "GeometryNodeRepeatOutput", "NodeClosureInput",
        "NodeClosureOutput", "NodeEvaluateClosure", "NodeCombineBundle", "NodeSeparateBundle", "NodeJoinBundle"}
"""Nodes that Blender removes from the tree before Cycles gets it: the linter judges their inputs instead."""
STRUCTURE = {"NodeFrame", "NodeReroute", "NodeGroupInput", "NodeGroupOutput", "ShaderNodeGroup",
             "ShaderNodeOutputMaterial", "ShaderNodeOutputLight", "ShaderNodeOutputWorld", "ShaderNodeOutputAOV",
             "ShaderNodeOutputLineStyle"}
"""Nodes that the linter passes through, and outputs."""


@dataclass(frozen=True)
class Verdict:
    """One of VERDICTS, with an explanation."""

    verdict: str
    text: str


SPECIAL = {"ShaderNodeBlackbody": Verdict(APPROXIMATED, BLACKBODY_BIAS),
           "ShaderNodeTexSky": Verdict(APPROXIMATED, SKY_BIAS),
           "ShaderNodeWavelength": Verdict(APPROXIMATED, WAVELENGTH_BIAS),
           "ShaderNodeScript": Verdict(APPROXIMATED, SCRIPT_BIAS),
           "ShaderNodeShaderToRGB": Verdict(REJECTED, NO_EFFECT)}


def judge_value(output, kind):
    """The Verdict on a node that feeds a socket of the given kind.

    Parameters
    ----------
    output : bpy.types.NodeSocket
    kind : str
        REFLECTANCE, EMISSION or CHANNELS of `spectral_sockets`.
    """
    node = output.node
    if node.bl_idname in SPECIAL:
        return SPECIAL[node.bl_idname]
    if node.bl_idname not in COLOURS | ARITHMETIC:
        return Verdict(REJECTED, UNKNOWN)
    space = _colour_space(node)
    if space == "Non-Color" and kind != CHANNELS:
        return Verdict(APPROXIMATED, NON_COLOUR_BIAS)
    if any(name in space for name in WIDE_SPACES):
        return Verdict(APPROXIMATED, WIDE_BIAS)
    what = "a grey with a flat spectrum" if output.type == "VALUE" and kind == REFLECTANCE else "computed in RGB"
    return Verdict(UPSAMPLED, f"{what}, then upsampled as {AS[kind]}")


def colour_inputs(node):
    """The inputs of a value node whose colours affect its output."""
    if node.bl_idname in ARITHMETIC:
        return [socket for socket in node.inputs if socket.enabled and socket.name not in ("Factor", "Fac")]
    return [socket for socket in node.inputs if socket.enabled and socket.type == "RGBA"]


def _colour_space(node):
    image = getattr(node, "image", None)
    return image.colorspace_settings.name if image else ""
