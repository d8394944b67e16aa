"""The frames of the capture: thumbnails, comparison of a frame with its render, and correction of floor masks."""
