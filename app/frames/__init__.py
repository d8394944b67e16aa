"""The frames of the capture: thumbnails, a frame beside the render from its camera, and correcting its floor
mask."""
