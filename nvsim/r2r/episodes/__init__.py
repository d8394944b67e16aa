"""Tasks as continuous episodes: collision-free actions along a path, and files for VLN-CE and StreamVLN.

Needs no other simulator."""
