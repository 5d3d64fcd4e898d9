"""A stand-in for Blender's layouts, which draw only in windows."""

from types import SimpleNamespace

import bpy


class Layout:
    """Records the properties, operators and pictures that are shown, the properties that are greyed out, and the texts
    of labels."""

    def __init__(self, parent=None, folded=False):
        self.active, self._parent = True, parent
        self.shown = parent.shown if parent else []
        self.greyed = parent.greyed if parent else []
        self.labels = parent.labels if parent else []
        self.folded = parent.folded if parent else folded

    def prop(self, owner, name, **_):
        assert name in owner.bl_rna.properties
        self.shown.append(name)
        if not self._is_active():
            self.greyed.append(name)

    def _is_active(self):
        return self.active and (self._parent is None or self._parent._is_active())

    def operator(self, name, **_):
        module, function = name.split(".")
        self.shown.append(name)
        properties = getattr(getattr(bpy.ops, module), function).get_rna_type().properties
        return SimpleNamespace(**dict.fromkeys(properties.keys()))

    def menu(self, name, **_):
        assert hasattr(bpy.types, name)
        self.shown.append(name)

    def template_icon(self, icon_value, scale):
        assert scale > 0
        self.shown.append("picture")

    def template_icon_view(self, owner, name, **_):
        self.prop(owner, name)

    def prop_search(self, owner, name, *_, **__):
        self.prop(owner, name)

    def column(self, **_):
        return Layout(self)

    row = box = split = grid_flow = column

    def progress(self, factor, text):
        assert 0 <= factor <= 1
        self.labels.append(text)

    def panel(self, idname, default_closed=False):
        return Layout(self), None if self.folded else Layout(self)

    def label(self, text="", **_):
        self.labels.append(text)

    def separator(self, **_):
        pass
