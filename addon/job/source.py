"""The files that what is open was read from: a digest that is another one as soon as any of them is.

A scene's fingerprint leaves out the weights of vertex groups and the pixels of images; what is in files, and not
changed since, is told whole by them. So passes are kept for another process only where the files vouch for them.
"""

import os
import re
from hashlib import blake2b
from pathlib import Path

import bpy

from ..scene.fingerprint import blocks_of
from ..shading.assigned import fields_of

NUMBER = re.compile(r"\d+|<UDIM>|<UVTILE>|#+")
READ_BYTES = 1 << 24


def source_digest(scene):
    """Of all files that the open .blend's scene depends on, as they are now: text; "" where it is in none.

    Of the .blend itself every byte counts, of others name, size and time. It is for the caller to know that nothing
    has been changed since it was opened: in the background Blender does not.
    """
    if not os.path.isfile(bpy.data.filepath):
        return ""
    digest = blake2b(digest_size=16)
    with open(bpy.data.filepath, "rb") as blend:
        while block := blend.read(READ_BYTES):
            digest.update(block)
    for path in sorted(_others(scene)):
        status = path.stat() if path.is_file() else None
        digest.update(f"{path} {status and (status.st_size, status.st_mtime_ns)}\n".encode(errors="surrogateescape"))
    return digest.hexdigest()


def window_digest(scene):
    """The same in a window, which knows what has been changed: "" where anything is other than in the files."""
    changed = bpy.data.is_dirty or any(image.is_dirty for image in bpy.data.images)
    return "" if changed else source_digest(scene)


def _others(scene):
    """Files that the scene's data-blocks name, and all frames, tiles and caches that go with them: set of Path."""
    blocks = blocks_of(scene)
    found = {Path(bpy.path.abspath(library.filepath)) for library in bpy.data.libraries} | {
        Path(bpy.path.abspath(path, library=block.library))
        for block, paths in bpy.data.file_path_map(subset=blocks).items() for path in (*paths, *_spectra(block))}
    alike = {}
    for path in found:
        alike.setdefault(path.parent, set()).add(_numbered(path))
    for folder, names in alike.items():
        found |= {path for path in (folder.iterdir() if folder.is_dir() else ()) if _numbered(path) in names}
    for folder in _cache_folders(blocks):
        found |= {Path(above, name) for above, _, names in os.walk(folder) for name in names}
    return found


def _numbered(path):
    return NUMBER.sub("#", path.name)


def _spectra(block):
    """What it names in its Lensfield Spectra: files among them."""
    return [text for field in fields_of(block) if (text := getattr(block.lensfield, field).strip())]


def _cache_folders(blocks):
    """Folders of simulations and bakes."""
    blend = Path(bpy.data.filepath)
    yield blend.with_name(f"blendcache_{blend.stem}")
    for modifier in (modifier for block in blocks if block.id_type == "OBJECT" for modifier in block.modifiers):
        if modifier.type == "NODES":
            yield from (bpy.path.abspath(folder) for folder in (
                modifier.bake_directory, *(bake.directory for bake in modifier.bakes)) if folder)
        elif modifier.type == "FLUID" and modifier.domain_settings:
            yield bpy.path.abspath(modifier.domain_settings.cache_directory)
