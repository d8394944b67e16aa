"""What a person decides about tasks: which are good, what they should say instead, and which an edited graph breaks."""
