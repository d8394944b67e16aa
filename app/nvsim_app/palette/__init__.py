"""The command palette: finds every command of the window by a few letters."""
