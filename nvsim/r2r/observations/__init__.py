"""Exports the images of every viewpoint in Matterport3D's layout: strips, depth, views and floor plans."""
