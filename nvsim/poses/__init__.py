"""Poses that agree with the images: what several images show in common is followed, and cameras and points are adjusted
together. Knows images and cameras; no project, no stage, and not whether there is a scan."""
