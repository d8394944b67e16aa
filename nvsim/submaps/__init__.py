"""Split the trajectory into overlapping submaps (paper section III-B). Uses camera positions only, no images."""
