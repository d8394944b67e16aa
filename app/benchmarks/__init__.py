"""The window measures itself: start, pace, gaps, edits. Known only by what starts the window."""
