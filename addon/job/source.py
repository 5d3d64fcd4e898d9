"""A digest of the files that the open scene was read from: it changes as soon as any of them does.

A scene's fingerprint leaves out the weights of vertex groups and the pixels of images. Unchanged files determine these
completely, so passes are stored for another process only if the scene is as its files have it.
"""

import os
import re
from hashlib import blake2b
from pathlib import Path

import bpy

from lensfield.engine.runtime.blender_caches import (
    BAKES,
    FLUID,
    MODIFIER_BAKES,
    OCEAN,
    POINTS,
    blend_caches,
    cache_files,
)
from lensfield.engine.runtime.files import file_status
from lensfield.engine.runtime.inputs import MOST_BYTES, MOST_FONT_BYTES, check_named

from ..scene.fingerprint import blocks_of
from ..scene.trust import trusts_all
from ..shading.assigned import fields_of, spectrum_path
from .named_files import named_files

NUMBER = re.compile(r"\d+|<UDIM>|<UVTILE>|#+")
READ_BYTES = 1 << 24
MOST_OF = {"FONT": MOST_FONT_BYTES} | dict.fromkeys(("SOUND", "MOVIECLIP", "VOLUME", "CACHEFILE", "SCENE"))
"""Largest file size in bytes for each kind of data-block; None for files that Blender reads piece by piece."""


def source_digest(scene):
    """The digest of all files that the scene depends on, as they are now: text; "" if the .blend is not saved.

    It covers every byte of the .blend, and the name, size and time of other files. The caller must know that the scene
    has not changed since it was opened: in the background Blender does not track changes.
    """
    if not os.path.isfile(bpy.data.filepath):
        return ""
    digest = blake2b(digest_size=16)
    with open(bpy.data.filepath, "rb") as blend:
        while block := blend.read(READ_BYTES):
            digest.update(block)
    for path in sorted(_all_alike(_others(scene))):
        status = file_status(path)
        digest.update(f"{path} {status and (status.st_size, status.st_mtime_ns)}\n".encode(errors="surrogateescape"))
    return digest.hexdigest()


def check_sources(scene):
    """Raise an InputError for a file of the scene that Blender should not open: a pipe, a device, an endless file.

    Parameters
    ----------
    scene : bpy.types.Scene
        In a window, no file is accessed while the .blend names an untrusted one.
    """
    if not trusts_all() and named_files():
        return
    for named, block in _others(scene).items():
        kind = block.rna_type.name.lower() if block else "cache"
        by = f"{kind} {block.name!r}" if block else "the scene"
        for path in _all_alike([named]) if _is_sequence(block) else [named]:
            check_named(path, kind, by, MOST_OF.get(block.id_type, MOST_BYTES) if block else None)


def window_digest(scene):
    """`source_digest` for a window, where Blender tracks changes: "" if anything differs from the files."""
    changed = bpy.data.is_dirty or any(image.is_dirty for image in bpy.data.images)
    return "" if changed else source_digest(scene)


def _others(scene):
    """Files that the scene's data-blocks name, and cache files: dict of Path to data-block, or to None for a cache."""
    blocks = [block for block in blocks_of(scene) if not getattr(block, "packed_file", None)]
    files = {Path(bpy.path.abspath(library.filepath)): library for library in bpy.data.libraries}
    for block, paths in bpy.data.file_path_map(subset=blocks).items():
        files |= {Path(bpy.path.abspath(path, library=block.library)): block for path in (*paths, *_spectra(block))}
    return files | dict.fromkeys(_caches([scene, *blocks]))


def _caches(blocks):
    """Files of simulations and bakes."""
    blends = filter(None, (bpy.data.filepath, *(bpy.path.abspath(library.filepath) for library in bpy.data.libraries)))
    caches = [path for blend in blends for path in blend_caches(blend)]
    for block in blocks:
        for folder, names in _cache_folders(block):
            caches += cache_files(bpy.path.abspath(folder, library=block.library), names) if folder else []
    return caches


def _all_alike(paths):
    """The files with all frames and tiles of their sequences: set of Path."""
    files, alike = set(paths), {}
    for path in files:
        alike.setdefault(path.parent, set()).add(_numbered(path))
    for folder, names in alike.items():
        files |= {path for path in (folder.iterdir() if folder.is_dir() else ()) if _numbered(path) in names}
    return files


def _is_sequence(block):
    """Whether a data-block's path covers several files: frames, or tiles."""
    return getattr(block, "source", "") in ("SEQUENCE", "TILED") or getattr(block, "is_sequence", False)


def _numbered(path):
    return NUMBER.sub("#", path.name)


def _spectra(block):
    """Files that a data-block names in its Lensfield Spectra."""
    return [path for field in fields_of(block) if (path := spectrum_path(block, field))]


def _cache_folders(block):
    """(folder, names of its files) of the simulations and bakes that an object or scene names; the folder may be ""."""
    if block.id_type == "SCENE" and block.rigidbody_world:
        yield from _external([block.rigidbody_world])
    for modifier in block.modifiers if block.id_type == "OBJECT" else ():
        if modifier.type == "NODES":
            yield modifier.bake_directory, MODIFIER_BAKES
            yield from ((bake.directory, BAKES) for bake in modifier.bakes if bake.use_custom_path)
        elif modifier.type == "FLUID" and modifier.domain_settings:
            yield modifier.domain_settings.cache_directory, FLUID
        elif modifier.type == "OCEAN" and modifier.is_cached:
            yield modifier.filepath, OCEAN
        else:
            yield from _external(_with_point_caches(modifier))


def _with_point_caches(modifier):
    """The owners of a modifier's point caches: the simulation itself, its particles or its surfaces."""
    if modifier.type == "PARTICLE_SYSTEM":
        return [modifier.particle_system]
    if modifier.type == "DYNAMIC_PAINT":
        return modifier.canvas_settings.canvas_surfaces if modifier.canvas_settings else []
    return [modifier] if modifier.type in ("CLOTH", "SOFT_BODY") else []


def _external(simulations):
    return ((each.point_cache.filepath, POINTS) for each in simulations if each.point_cache.use_external)
