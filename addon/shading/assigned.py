"""What the user assigned to materials, lights and worlds: spectra and refractive indices by name, file or pairs."""

import bpy

from ...engine.errors import InputError
from ...engine.spectral.refraction import load_refraction
from ...engine.spectral.spectra import BAND_NM, load_spectrum
from ..scene.errors import SceneError

LOADERS = {"reflectance": load_spectrum, "emission": load_spectrum, "refraction": load_refraction}
WORDS = {"reflectance": "reflectance spectrum", "emission": "emission spectrum", "refraction": "refraction"}


class AssignedSpectra:
    """Reads what data-blocks name in their Lensfield Spectra, each text once.

    Parameters
    ----------
    wavelengths_nm : sequence of float
        At which refractive indices are needed.
    dispersion : bool
        Whether glass takes its index at each of them, or that of the D line at all.
    """

    def __init__(self, wavelengths_nm=(), dispersion=True):
        self._read, self._wavelengths_nm, self._dispersion = {}, wavelengths_nm, dispersion

    def of(self, data_block, field):
        """The spectrum or refraction that a field of a data-block names; None without one, or where it has an error."""
        return self._outcome(data_block, field)[0]

    def error_of(self, data_block, field):
        """The SceneError of a field whose text cannot be read, or None.

        Nor can an emission be that has no light in BAND_NM, or a refraction that is not known where it counts.
        """
        error = self._outcome(data_block, field)[1]
        return error and SceneError(f"{data_block.rna_type.name.lower()} {data_block.name!r}", WORDS[field],
                                    getattr(data_block.lensfield, field).strip(),
                                    f"{error.field} {error.value}: {error.remedy}")

    def errors(self, data_blocks):
        """All errors of these data-blocks."""
        found = [self.error_of(block, field) for block in data_blocks for field in fields_of(block)]
        return [error for error in found if error]

    def _outcome(self, data_block, field):
        text = getattr(data_block.lensfield, field).strip()
        if not text:
            return None, None
        key = field, text, data_block.library  # relative paths are beside the .blend that a data-block is from
        if key not in self._read:
            self._read[key] = self._load(data_block, field, text)
        return self._read[key]

    def _load(self, data_block, field, text):
        """What a text names, and None; or None, and the InputError that tells why not."""
        try:
            # Blender writes paths beside the .blend as //name.
            loaded = LOADERS[field](bpy.path.abspath(text, library=data_block.library),
                                    bpy.path.abspath("//", library=data_block.library))
            if field == "emission":
                loaded.density_at(BAND_NM)
            if field == "refraction":
                self._check_refraction(loaded)
        except InputError as error:
            return None, error
        return loaded, None

    def _check_refraction(self, refraction):
        if refraction.metal:
            refraction.reflectance_at(self._wavelengths_nm)
        elif self._dispersion and refraction.dispersive:
            refraction.n_at(self._wavelengths_nm)


def fields_of(data_block):
    """The fields of a data-block that may name something."""
    return [field for field in LOADERS if hasattr(getattr(data_block, "lensfield", None), field)]
