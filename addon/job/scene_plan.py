"""The scene's plan: which wavelengths Cycles renders, in how many passes, in which light groups, and why."""

from dataclasses import dataclass

import numpy as np

from ...engine.errors import InputError
from ...engine.image.depth_range import DEPTHS
from ...engine.spectral.spectra import BAND_NM
from ...engine.spectral.wavelength_choice import UNFIT, WavelengthChoice, choose_wavelengths
from ..scene.camera import in_view, render_region
from ..scene.errors import SceneError
from ..scene.instances import rendered_blocks, rendered_instances
from ..scene.render_state import rendered_layer
from ..scene.traced_camera import check_traceable
from ..scene.working_space import colour_basis
from ..shading.assigned import AssignedSpectra
from ..shading.lamps import Lamps, LightGroups
from ..shading.lint import judge
from ..shading.node_rules import REJECTED, SEPARATED
from ..shading.substitution import Substitution
from .bands import WAVELENGTHS_PER_PASS, passes


@dataclass(frozen=True, eq=False)
class ScenePlan:
    """How a scene's radiance will be rendered.

    Attributes
    ----------
    choice : WavelengthChoice
        The wavelengths that are rendered, and how those asked for follow.
    lamps : list of Lamp
        One for each light group; the first is that of the light in none of ours.
    per_pass : 3 or 1
        Wavelengths that a pass carries.
    dispersive : bool
        Whether glass has another index at each wavelength.
    apart : str
        Why a pass carries a single wavelength, if it does.
    unfit : bool
        Whether there is something in the scene that Cycles renders in red, green and blue, whatever the wavelengths.
    findings : tuple of Finding
        What becomes of its nodes.
    refusals : tuple of SceneError
        Why the scene cannot be rendered as it stands, after all; the plan is that of what is known of it.
    """

    choice: WavelengthChoice
    lamps: list
    per_pass: int
    dispersive: bool
    apart: str
    unfit: bool
    findings: tuple
    refusals: tuple

    @property
    def bands(self):
        """Wavelengths of each pass, nm, for red, green and blue."""
        return passes(self.choice.nodes_nm, self.per_pass)

    def shares(self, index):
        """What the wavelengths of a pass give to the radiance at each asked for: array (wavelength, lamp, of pass)."""
        lamps = np.stack([lamp.output_at(self.choice.output_nm) for lamp in self.lamps], axis=-1)
        return lamps[:, :, None] * self.choice.weights[:, None, self.nodes(index)]

    def mix(self, index):
        """What the wavelengths of a pass take of its planes: array (of pass, channel), channels as in CHANNELS.

        Each wavelength has a channel of its own. But where one rides in all three and they differ, by what Cycles
        colours in RGB, they are mixed as a colour is upsampled; what is substituted is alike in all three and stays.
        """
        nodes_nm = self.choice.nodes_nm[self.nodes(index)]
        if self.unfit and self.per_pass == 1:
            return colour_basis(nodes_nm)[:, ::-1]
        return np.eye(nodes_nm.size)

    def nodes(self, index):
        """Which of the wavelengths that are rendered ride in a pass: a slice."""
        return slice(index, None, len(self.bands))

    @property
    def text(self):
        """The passes, why these, and how true colours will be, in one line."""
        renders = f"{len(self.bands)} Cycles render{'s' * (len(self.bands) > 1)}"
        why = "; ".join(filter(None, (self.choice.reason, self.apart)))
        text = f"{renders} at {', '.join(f'{nm:g}' for nm in self.choice.nodes_nm)} nm: {why}"
        error = self.choice.colour_error
        return text + (f"; colours within a CIEDE2000 of about {error:.2g}" if error else "")

    def check(self):
        """Raise the first of the refusals."""
        if self.refusals:
            raise self.refusals[0]


def check_job(scene, job):
    """Raise an InputError for what can be known to fail before anything is changed or rendered."""
    if job.unfit not in UNFIT:
        raise InputError("options", "unfit", job.unfit, f"expected {' or '.join(UNFIT)}")
    if job.depth not in DEPTHS:
        raise InputError("options", "depth", job.depth, f"expected {', '.join(DEPTHS)}")
    if job.traced:
        check_traceable(job.lens)
    if not len(job.wavelengths_nm):
        raise InputError("options", "wavelengths", "empty", "expected at least one")
    for nm in job.wavelengths_nm:
        job.lens.at_wavelength(nm)
        if not BAND_NM[0] <= nm <= BAND_NM[1]:
            raise InputError("options", "wavelength", f"{nm:g} nm",
                             "colours and lights of a scene reach from {:g} to {:g} nm".format(*BAND_NM))
    if scene.background_set:
        raise SceneError(f"scene {scene.name!r}", "background set", scene.background_set.name,
                         "link its collections into this scene instead")
    _check_view_layers(scene, job.view_layer)
    render_region(scene)


def _check_view_layers(scene, chosen):
    names = [layer.name for layer in scene.view_layers]
    if chosen and chosen not in names:
        raise SceneError(f"scene {scene.name!r}", "view layer", chosen, f"expected {' or '.join(names)}")
    on = [layer.name for layer in scene.view_layers if layer.use]
    if not chosen and len(on) != 1:
        raise SceneError(f"scene {scene.name!r}", "view layers for rendering", ", ".join(on) or "none",
                         "choose one of them: View Layer in Lensfield's settings, or --view-layer")


def plan_scene(scene, job, grid, journal):
    """Judge a scene, wire it for its passes, and plan them.

    What cannot be rendered by wavelengths, where the job does not take that as it comes, spectra that cannot be read
    and what cannot be wired are among the plan's refusals; all but the first are left out of it.

    Returns
    -------
    ScenePlan, Substitution, LightGroups
    """
    spectra = AssignedSpectra(job.wavelengths_nm, dispersion=job.spectral.tier != "preview")
    rendered = rendered_blocks(scene)
    findings = judge(scene, rendered, spectra)
    of_nodes = [finding for finding in findings if not finding.of_spectrum]
    rejected = [finding for finding in of_nodes if finding.verdict == REJECTED]
    shining, glass = _survey(scene, spectra, job, grid)
    coupled = [str(finding) for finding in of_nodes if finding.verdict in (REJECTED, SEPARATED)]
    apart = "" if job.spectral.tier == "preview" else glass or next(iter(coupled), "")
    apart = "rays through the lens are of one wavelength" if job.traced else apart
    per_pass = 1 if apart else WAVELENGTHS_PER_PASS
    lamps = Lamps(spectra, job.wavelengths_nm)
    groups = LightGroups(shining, lamps, together=job.denoise)
    substitution = Substitution(scene, journal, spectra, lamps, groups, rendered)
    choice = choose_wavelengths(substitution.factors, [lamp.output_at for lamp in groups.lamps], job.wavelengths_nm,
                               job.spectral, mixed_colours=substitution.mixed_colours or bool(rejected),
                               per_pass=per_pass,
                               dispersive=bool(glass) or (job.traced and job.spectral.tier != "preview"))
    refusals = (*spectra.errors(rendered), *substitution.refusals,
                *_refusals(rejected if job.unfit == "refuse" else ()))
    plan = ScenePlan(choice, groups.lamps, per_pass, bool(glass), apart, bool(rejected), findings, refusals)
    return plan, substitution, groups


def _refusals(rejected):
    """The SceneError for what cannot be rendered by wavelengths, if there is any."""
    if rejected:
        others = f" (and {len(rejected) - 1} more)" if len(rejected) > 1 else ""
        yield SceneError(rejected[0].place, "node", "rejected",
                         f"{rejected[0].text}{others}; Check Scene and `lensfield lint` list all; or have unfit nodes "
                         "rendered as Cycles does, in RGB")


def _survey(scene, spectra, job, grid):
    """What may shine, objects and the world, each with the data-blocks that it may shine by; and a few words about
    glass in view whose index varies with wavelength, which previews do without."""
    world = rendered_layer(scene).world_override or scene.world
    shining, glass, dispersive = {world: {world}} if world else {}, "", {}
    for instance in rendered_instances(scene):
        blocks = {instance.obj.data} if instance.obj.type == "LIGHT" else instance.materials
        shining.setdefault(instance.obj, set()).update(blocks)
        if glass or job.spectral.tier == "preview":
            continue
        for material in instance.materials:
            if material not in dispersive:  # there may be many instances of few materials
                refraction = spectra.of(material, "refraction")
                dispersive[material] = refraction and not refraction.metal and refraction.dispersive
            if dispersive[material] and in_view(scene.camera, instance.box, job.lens, grid):
                glass = f"{instance.obj.name!r} of {material.name!r} is in view and disperses"
    return shining, glass
