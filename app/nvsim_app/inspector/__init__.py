"""The viewpoint inspector: shows the measurements around a viewpoint in its panorama."""
