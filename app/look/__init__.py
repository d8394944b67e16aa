"""How the window looks: colours that mean something, theme, icons, notices, hints. Knows no document."""
