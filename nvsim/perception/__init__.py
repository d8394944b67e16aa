"""From an image to its floor mask: semantic, normals and prompted mask in three roles, and the geometric provider that
plays all three. Inference only; knows no models of the scene."""
