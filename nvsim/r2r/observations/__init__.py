"""What is seen from every viewpoint, as files in Matterport3D's layout: strips, depth, views and floor plans."""
