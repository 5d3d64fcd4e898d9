"""The linter: judges every node that reaches a rendered surface, light or world by how its colours become spectra.

It walks backwards from the output that Cycles uses, through groups, reroutes and muted nodes, as Cycles does. The
verdicts come from `node_rules` and `closure_rules`. `spectral_sockets` lists the inputs that carry colours, for the
linter and for the substitution.
"""

from collections import Counter
from dataclasses import dataclass

import bpy

from ..scene.instances import DRAWN_TYPES, cycles_output, rendered_blocks, uses_nodes
from ..scene.working_space import REC709, working_space
from .assigned import WORDS, AssignedSpectra, fields_of
from .closure_rules import LENGTHS, channels_finding, closure_findings, is_idle
from .lamps import blackbody_temperature
from .node_paths import constant_of, source_of
from .node_rules import APPROXIMATED, FLOW, REJECTED, SUBSTITUTED, UPSAMPLED, VERDICTS, colour_inputs, judge_value
from .spectral_sockets import CHANNELS, EMISSION, INDEX, REFLECTANCE, is_shader, kind, takes_reflectance
from .substitution import Assigned

SHADER = "shader"

BROKEN_GROUP = "its node tree is missing or has no output: Cycles renders black"
COLOUR_AS_SHADER = "a colour linked to a shader input: it emits light, as in Cycles, upsampled with D65 as white"
DRAWN = "Blender draws it over the picture in RGB: hide it from renders"
CONSTANTS = "constant colours become spectra"
COLOURLESS = "colourless, the same at all wavelengths"


@dataclass(frozen=True)
class Finding:
    """The verdict on one node of a scene.

    Attributes
    ----------
    object_names : tuple of str
        The objects that bring the data-block into the render; empty for a world.
    block_type, block_name : str
        The data-block: material, light, world ...
    node : str
        Its label in the tree, after the labels of its groups; empty for the data-block itself.
    socket : str
        Empty for the complete node.
    verdict : str
        One of VERDICTS.
    text : str
        The effect on the picture, and the remedy.
    """

    object_names: tuple[str, ...]
    block_type: str
    block_name: str
    node: str
    socket: str
    verdict: str
    text: str

    @property
    def place(self):
        """The objects, the data-block, the node and its input, as one string."""
        more = len(self.object_names) - 1
        objects = self.object_names[0] + (f" (and {more} more)" if more else "") if self.object_names else ""
        path = " > ".join(filter(None, (f"{self.block_type} {self.block_name!r}", self.node, self.socket)))
        return ": ".join(filter(None, (objects, path)))

    @property
    def of_spectrum(self):
        """Whether it is about an unreadable spectrum, and therefore not about a node."""
        return self.verdict == REJECTED and self.socket in WORDS.values()

    def __str__(self):
        return ": ".join(filter(None, (self.place, self.verdict, self.text)))


def lint(scene):
    """Judge every node that reaches a render of a scene.

    Parameters
    ----------
    scene : bpy.types.Scene

    Returns
    -------
    tuple of Finding, worst first
    """
    return judge(scene, rendered_blocks(scene), AssignedSpectra())


def judge(scene, rendered, spectra):
    """Like `lint`, with the rendered data-blocks (see `rendered_blocks`) and their spectra given."""
    findings = list(_of_scene(scene))
    for block, names in rendered.items():
        findings += (Finding(names, block.id_type.lower(), block.name, *rest) for rest in _judged(block, spectra))
    return tuple(sorted(findings, key=lambda finding: (VERDICTS.index(finding.verdict), str(finding))))


def counts_text(findings):
    """The number of findings with each verdict, as text."""
    counts = Counter(finding.verdict for finding in findings)
    return ", ".join(f"{counts[verdict]} {verdict}" for verdict in VERDICTS if counts[verdict]) or "nothing to judge"


def _of_scene(scene):
    """Findings about the scene itself."""
    if scene.background_set:
        yield Finding((), "scene", scene.name, "", "background set", REJECTED,
                      f"{scene.background_set.name!r} is not checked: link its collections into this scene instead")
    if working_space() != REC709:
        yield Finding((), "scene", scene.name, "", "working colour space", APPROXIMATED,
                      f"{working_space()}: its colours outside Rec. 709 become less saturated")


def _judged(block, spectra):
    """(node, socket, verdict, text) for everything in a data-block."""
    if block.id_type in DRAWN_TYPES | {"GREASEPENCIL_V3"}:
        return [("", "", REJECTED, DRAWN)]
    given = {field: spectra.of(block, field) for field in fields_of(block)}
    findings = [("", error.field, REJECTED, f"{error.value}: {error.remedy}") for error in spectra.errors([block])]
    if isinstance(block, bpy.types.Light):
        findings.append(("", *_light_colour(block, given)))
    if not uses_nodes(block):
        return findings if isinstance(block, bpy.types.Light) else [*findings, ("", "Color", SUBSTITUTED, CONSTANTS)]
    output = cycles_output(block)
    return [*findings, *_Walk(block, given).findings(output)] if output else findings


def _light_colour(light, given):
    if given.get("emission"):
        return "", SUBSTITUTED, "uses its assigned emission"
    if light.use_temperature:
        return "Temperature", SUBSTITUTED, "Planck's law"
    return "Color", SUBSTITUTED, "becomes a spectrum, with D65 as white"


class _Walk:
    """Walks from the output of a data-block's tree back to the sources of its colours."""

    def __init__(self, block, given):
        self._block = block
        self._emission = given.get("emission")
        self._assigned = Assigned(reflectance=given.get("reflectance"), refraction=given.get("refraction"))
        self._findings = {}  # an ordered set
        self._visited = set()
        self._pending = []

    def findings(self, output):
        """(node, socket, verdict, text) of every node that feeds an output node's Surface or Volume; displacement is
        not a colour."""
        self._pending = [(output.inputs[name], (), SHADER) for name in ("Surface", "Volume") if name in output.inputs]
        while self._pending:
            socket, groups, how = self._pending.pop()
            source, groups, _ = source_of(socket, groups)
            key = source and (groups, source.node, source.identifier, how)
            if source and key not in self._visited:
                self._visited.add(key)
                self._visit(source, groups, how)
        return list(self._findings)

    def _visit(self, source, groups, how):
        node = source.node
        if node.bl_idname in FLOW:
            self._go_on((socket for socket in node.inputs if _may_carry(socket, how)), groups, how)
        elif node.bl_idname == "ShaderNodeGroup":
            self._add(node, groups, None, REJECTED, BROKEN_GROUP)
        elif is_shader(node):
            self._closure(node, groups)
        elif how == SHADER:
            self._add(node, groups, source, APPROXIMATED, COLOUR_AS_SHADER)
            if not self._emission:
                self._visit(source, groups, EMISSION)
        else:
            judged = judge_value(source, how)
            self._add(node, groups, source, judged.verdict, judged.text)
            self._go_on(colour_inputs(node), groups, how)

    def _closure(self, node, groups):
        def value_of(socket):
            return constant_of(socket, groups)

        entire_node = None
        for socket, verdict, text in closure_findings(node, value_of):
            self._add(node, groups, socket, verdict, text)
            entire_node = entire_node or socket is None
        if entire_node:
            return
        self._go_on((socket for socket in node.inputs if socket.type == "SHADER"), groups, SHADER)
        coloured = [socket for socket in node.inputs if kind(node, socket) not in (None, INDEX)
                    and not is_idle(node, socket, value_of)]
        known = {self._known_input(node, socket, groups, value_of) for socket in coloured} - {None}
        if known or not coloured:
            self._add(node, groups, None, SUBSTITUTED, ", ".join(sorted(known)) or COLOURLESS)
        else:
            self._add(node, groups, None, UPSAMPLED, "its colours are computed by nodes")

    def _known_input(self, node, socket, groups, value_of):
        """How a closure's input becomes spectral, as text; None if nodes compute it, which are then judged."""
        how = kind(node, socket)
        assigned = self._assigned_to(node, socket, how)
        if assigned:
            return f"{socket.name} uses the assigned {assigned}"
        if how == EMISSION and self._is_thermal(socket):
            return f"{socket.name} is a blackbody by Planck's law"
        if how == CHANNELS:
            value = value_of(socket)
            approximated = (APPROXIMATED, LENGTHS) if value is None else channels_finding(socket, value)
            if approximated:
                self._add(node, groups, socket, *approximated)
        if source_of(socket, groups)[0] is None:
            return CONSTANTS
        self._go_on([socket], groups, how)
        return None

    def _assigned_to(self, node, socket, how):
        """The field of the assigned spectrum that replaces an input, or None."""
        if how == EMISSION:
            return "emission" if self._emission else None
        if how == REFLECTANCE and takes_reflectance(node, socket):
            return "reflectance" if self._assigned.reflectance else "refraction" if self._assigned.metal else None
        if how == CHANNELS and socket.name in ("IOR", "Extinction"):
            return "refraction" if self._assigned.metal else None
        return None

    def _is_thermal(self, socket):
        return blackbody_temperature(socket) and not getattr(self._block, "use_temperature", False)

    def _go_on(self, sockets, groups, how):
        self._pending += [(socket, groups, how) for socket in sockets]

    def _add(self, node, groups, socket, verdict, text):
        path = " > ".join([*(group.label or group.node_tree.name for group in groups), node.label or node.name])
        self._findings[path, socket.name if socket else "", verdict, text] = None


def _may_carry(socket, how):
    """Whether an input of a FLOW node may carry shaders (`how` is SHADER) or values (any other `how`)."""
    return socket.type in ("BUNDLE", "CLOSURE") or (socket.type == "SHADER") == (how == SHADER)
