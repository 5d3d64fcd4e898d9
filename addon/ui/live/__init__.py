"""The viewport through a lens: Live, by the graphics card, and Quick Look, by the compositor."""
