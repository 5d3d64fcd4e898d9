"""The files in Blender's cache folders.

Blender opens caches by name, directly in their folder or in folders with fixed names. Other files there do not belong
to the scene: a cache folder may well be the project's own.
"""

from pathlib import Path

from .files import AnyPath, matching

POINTS = "*.bphys", "*_??????_??.vdb"
"""Particles, cloth, soft and rigid bodies, dynamic paint: NAME_000001_00.bphys. Earlier, smoke as .vdb."""
BAKES = "meta/*.json", "blobs/*"
"""Bakes of geometry nodes in a folder that a bake names."""
MODIFIER_BAKES = tuple(f"*/{pattern}" for pattern in BAKES)
"""The same in the folder that a modifier names: each bake has a folder in it."""
FLUID = tuple(f"{part}/*_*[0-9].*" for part in ("config", "data", "noise", "mesh", "particles", "guiding"))
"""fluid_data_0001.vdb; lMesh_0001.bobj.gz"""
OCEAN = tuple(f"{kind}_*.exr" for kind in ("disp", "foam", "normal", "spray"))
OF_BLEND = (*POINTS, *(f"*/{pattern}" for pattern in MODIFIER_BAKES))
"""All of these in `blendcache_NAME`, next to NAME.blend."""


def blend_caches(blend: AnyPath) -> list[Path]:
    """The existing cache files in the folder that belongs to a .blend."""
    blend = Path(blend)
    return cache_files(blend.with_name(f"blendcache_{blend.stem}"), OF_BLEND)


def cache_files(folder: AnyPath, names: tuple[str, ...]) -> list[Path]:
    """The existing cache files in a folder.

    Parameters
    ----------
    folder : path
        It may be missing.
    names : tuple of str
        A constant of this module.
    """
    return [path for name in names for path in matching(Path(folder), name)]
