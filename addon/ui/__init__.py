"""What the user sees and presses: panels, properties, operators."""
