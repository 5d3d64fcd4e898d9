"""The scene's plan: which wavelengths Cycles renders, in how many passes, in which light groups, and why."""

from dataclasses import dataclass

import numpy as np

from lensfield.engine.runtime.errors import InputError
from lensfield.engine.spectral.colour import rec709_weights
from lensfield.engine.spectral.spectra import BAND_NM, white_density
from lensfield.engine.spectral.wavelength_choice import WavelengthChoice, choose_wavelengths

from ..job.photo import check_photo
from ..job.source import check_sources
from ..scene.camera import frame_grid, in_view
from ..scene.devices import device_of
from ..scene.errors import SceneError
from ..scene.instances import rendered_blocks, rendered_instances
from ..scene.render_state import rendered_world
from ..scene.traced_camera import check_traceable
from ..scene.working_space import colour_basis
from ..shading.assigned import AssignedSpectra
from ..shading.lamps import Lamps, LightGroups
from ..shading.lint import judge
from ..shading.node_rules import REJECTED, SEPARATED
from ..shading.repeated import repeated_colours, tinting_objects
from ..shading.substitution import Substitution
from .bands import WAVELENGTHS_PER_PASS, nodes_of_passes, passes
from .truth import check_truth


@dataclass(frozen=True, eq=False)
class ScenePlan:
    """How a scene's radiance will be rendered.

    Attributes
    ----------
    choice : WavelengthChoice
        The rendered wavelengths, and their weights for the requested ones.
    lamps : list of Lamp
        One for each light group; the first is for light outside Lensfield's groups.
    per_pass : 3 or 1
        Wavelengths that a pass carries.
    dispersive : bool
        Whether the index of glass varies with wavelength.
    apart : str
        Why a pass carries a single wavelength, if it does.
    unfit : bool
        Whether the scene contains nodes that Cycles renders in red, green and blue, whatever the wavelengths.
    findings : tuple of Finding
        The treatment of its nodes.
    repeated : tuple of RepeatedIn
        The colours of glass and volumes, largest difference from an RGB render first.
    tinting : frozenset of str
        Names of the objects that tint light passing straight through them.
    refusals : tuple of SceneError
        Why the scene cannot be rendered in this state; the plan then covers the known part.
    """

    choice: WavelengthChoice
    lamps: list
    per_pass: int
    dispersive: bool
    apart: str
    unfit: bool
    findings: tuple
    repeated: tuple
    tinting: frozenset
    refusals: tuple

    @property
    def bands(self):
        """Wavelengths of each pass, nm, for red, green and blue."""
        return passes(self.choice.nodes_nm, self.per_pass)

    def shares(self, index):
        """Share of each of a pass's wavelengths in the radiance at each requested one: array (wavelength, lamp, of
        pass)."""
        lamps = np.stack([lamp.output_at(self.choice.output_nm) for lamp in self.lamps], axis=-1)
        return lamps[:, :, None] * self.choice.weights[:, None, self.nodes(index)]

    def mix(self, index):
        """Weights of a pass's planes for each of its wavelengths: array (of pass, channel), channels as in CHANNELS.

        Usually each wavelength has its own channel. If one wavelength is in all three channels, and nodes that Cycles
        renders in RGB make these differ, they are mixed as a colour is upsampled to a spectrum. Substituted values are
        equal in all three, and the mix leaves them unchanged.
        """
        nodes_nm = self.choice.nodes_nm[self.nodes(index)]
        if self.unfit and self.per_pass == 1:
            return colour_basis(nodes_nm)[:, ::-1]
        return np.eye(nodes_nm.size)

    def alpha_weights(self):
        """Weight of each pass in the mean of R, G and B of a white picture: array (pass,), which is even if none is
        visible."""
        nm = self.choice.output_nm
        white = rec709_weights(nm).mean(axis=1) * white_density(nm)
        weights = [np.maximum(white @ self.choice.weights[:, self.nodes(index)], 0).sum()
                   for index in range(len(self.bands))]
        return np.array(weights) if any(weights) else np.ones(len(self.bands))

    def nodes(self, index):
        """Indices of the rendered wavelengths that a pass carries: array."""
        return nodes_of_passes(self.choice.nodes_nm.size, self.per_pass)[index]

    @property
    def text(self):
        """The passes, the reason for them, and the expected colour error, in one line."""
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
    """Raise an InputError for a request that cannot be met, before anything is changed or rendered."""
    device_of(scene, job.device)
    if job.traced:
        check_traceable(job.lens)
    for nm in job.wavelengths_nm:
        job.lens.at_wavelength(nm)
    check_wavelengths(job.wavelengths_nm)
    check_photo(job, frame_grid(scene, job.lens))
    check_truth(scene, job)
    check_sources(scene)


def check_wavelengths(wavelengths_nm):
    """Raise an InputError unless there are wavelengths, and the spectra of scenes cover them."""
    if not len(wavelengths_nm):
        raise InputError("options", "wavelengths", "empty", "expected at least one")
    for nm in wavelengths_nm:
        if not BAND_NM[0] <= nm <= BAND_NM[1]:
            raise InputError("options", "wavelength", f"{nm:g} nm",
                             "the colours and lights of a scene cover {:g} to {:g} nm".format(*BAND_NM))


def plan_scene(scene, job, grid, journal):
    """Judge a scene, wire it for its passes, and plan them.

    The plan's refusals are nodes that cannot be rendered by wavelengths, unless the job accepts them; spectra that
    cannot be read; and nodes that cannot be wired. Only the first kind remains part of the plan.

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
    tinting = tinting_objects(scene)
    repeated = sorted(repeated_colours(scene, rendered_world(scene), spectra),
                      key=lambda each: each.rgb_difference[0], reverse=True)
    coupled = [str(finding) for finding in of_nodes if finding.verdict in (REJECTED, SEPARATED)]
    apart = "" if job.spectral.tier == "preview" else glass or next(iter(coupled), "")
    apart = "each traced ray has one wavelength" if job.traced else apart
    per_pass = 1 if apart else WAVELENGTHS_PER_PASS
    lamps = Lamps(spectra, job.wavelengths_nm)
    groups = LightGroups(shining, lamps, together=job.denoises)
    substitution = Substitution(scene, journal, spectra, lamps, groups, rendered)
    choice = choose_wavelengths(substitution.factors, [lamp.output_at for lamp in groups.lamps], job.wavelengths_nm,
                               job.spectral, repeated=[each.colour for each in repeated],
                               mixed_colours=substitution.mixed_colours or bool(rejected), per_pass=per_pass,
                               dispersive=bool(glass) or (job.traced and job.spectral.tier != "preview"))
    refusals = (*spectra.errors(rendered), *substitution.refusals,
                *_refusals(rejected if job.unfit == "refuse" else ()))
    plan = ScenePlan(choice, groups.lamps, per_pass, bool(glass), apart, bool(rejected), findings, tuple(repeated),
                     tinting, refusals)
    return plan, substitution, groups


def _refusals(rejected):
    """The SceneError for nodes that cannot be rendered by wavelengths, if any."""
    if rejected:
        others = f" (and {len(rejected) - 1} more)" if len(rejected) > 1 else ""
        yield SceneError(rejected[0].place, "node", "rejected",
                         f"{rejected[0].text}{others}; Check Scene and `lensfield lint` list all; or set Unfit Nodes "
                         "to Render Anyway (--unfit render)")


def _survey(scene, spectra, job, grid):
    """Possible light sources (objects and the world), each with the data-blocks that may emit; and a phrase about glass
    in view whose index varies with wavelength, which previews ignore."""
    world = rendered_world(scene)
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
