"""The frames of the walk: thumbnails, a frame beside the render from its camera, and correcting its floor mask."""
