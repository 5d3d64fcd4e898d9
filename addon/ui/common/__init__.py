"""What all parts of the window use: settings, the session, the lens in the background, lines of text."""
