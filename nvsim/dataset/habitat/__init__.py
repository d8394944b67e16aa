"""Write a scan as a scene for Habitat: a colored surface, a collision mesh, and their configurations."""
