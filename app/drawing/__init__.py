"""The drawing process and the window's end of it: who draws, how large, and in what time. Knows no document."""
