"""YAML from untrusted files: texts, lists and mappings, of limited size."""

from typing import Any

import yaml


def parse_yaml(text: str, most_nodes: int) -> Any:
    """The contents of a YAML text; its numbers stay texts.

    Raises
    ------
    ValueError
        The text is not YAML, has more nodes, or has aliases. Otherwise, a small file could take minutes and gigabytes.
    """
    try:
        return yaml.load(text, Loader=_loader(most_nodes))
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise ValueError(f"not YAML: {' '.join(str(error).split())}") from None


def _loader(most_nodes):
    class Loader(yaml.BaseLoader):
        nodes = 0

        def compose_node(self, parent, index):
            self.nodes += 1
            if self.nodes > most_nodes or self.check_event(yaml.AliasEvent):
                raise yaml.YAMLError("too many nodes, or an alias")
            return super().compose_node(parent, index)

    return Loader
