"""What the user assigned to materials, lights and worlds: spectra and refractive indices by name, file or pairs."""

import bpy

from ...engine.errors import InputError
from ...engine.spectral.refraction import D_LINE_NM, load_refraction
from ...engine.spectral.spectra import BAND_NM, load_spectrum
from ..scene.errors import SceneError

LOADERS = {"reflectance": load_spectrum, "emission": load_spectrum, "refraction": load_refraction}
WORDS = {"reflectance": "reflectance spectrum", "emission": "emission spectrum", "refraction": "refraction"}


class AssignedSpectra:
    """Reads what data-blocks name in their Lensfield Spectra, each text once."""

    def __init__(self):
        self._read = {}

    def of(self, data_block, field):
        """The spectrum or refraction that a field of a data-block names, or None.

        Raises
        ------
        SceneError
            It cannot be read; an emission has no light in BAND_NM, or a refraction's k is not known where it counts.
        """
        text = getattr(data_block.lensfield, field).strip()
        if not text:
            return None
        key = field, text, data_block.library  # relative paths are beside the .blend that a data-block is from
        if key not in self._read:
            self._read[key] = _load(data_block, field, text)
        return self._read[key]

    def check(self, data_blocks):
        """Raise a SceneError for the first that cannot be read."""
        for data_block in data_blocks:
            for field in LOADERS:
                if hasattr(data_block.lensfield, field):
                    self.of(data_block, field)


def _load(data_block, field, text):
    try:
        # Blender writes paths beside the .blend as //name.
        loaded = LOADERS[field](bpy.path.abspath(text, library=data_block.library),
                                bpy.path.abspath("//", library=data_block.library))
        if field == "emission":
            loaded.density_at(BAND_NM)
        if field == "refraction":
            loaded.k_at(D_LINE_NM)
        return loaded
    except InputError as error:
        raise SceneError(f"{data_block.rna_type.name.lower()} {data_block.name!r}", WORDS[field], text,
                         f"{error.field} {error.value}: {error.remedy}") from None
