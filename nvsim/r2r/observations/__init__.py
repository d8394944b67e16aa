"""What is seen from every viewpoint, as files in the layout of Matterport3D: strips of faces, depth, views, floor plans."""
