"""The colours of pictures of light: inferno, by N. J. Smith and S. van der Walt (github.com/BIDS/colormap, CC0-1.0)."""

import numpy as np

INFERNO = np.array([tuple(bytes.fromhex(colour)) for colour in (
    "000004 060419 120a32 230c4c 360961 490b6a 5a116e 6c186e 7f1e6c 902568 a22b62 b3325a "
    "c33b4f d24644 df5337 ea632a f3761b f8890c fb9d07 fcb216 f9c72f f4dd4f f1f179 fcffa4").split()], np.uint8)
"""Every eleventh of its 256 colours, from dark to light: uint8 array (step, 3)."""


def stepped(share: np.ndarray) -> np.ndarray:
    """Colours for shares from 0 to 1, in the steps of the table: uint8 array (..., 3)."""
    return INFERNO[np.clip((share * len(INFERNO)).astype(int), 0, len(INFERNO) - 1)]


def smooth(share: np.ndarray) -> np.ndarray:
    """Colours for shares from 0 to 1, interpolated: uint8 array (..., 3)."""
    places = np.linspace(0, 1, len(INFERNO))
    return np.rint(np.stack([np.interp(share, places, part) for part in INFERNO.T], axis=-1)).astype(np.uint8)
