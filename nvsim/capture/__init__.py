"""Read posed images into one typed Capture and check the data. It knows nothing of submaps or trained models."""
