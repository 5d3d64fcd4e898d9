"""The user interface: panels, properties, operators."""
