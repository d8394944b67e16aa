"""Camera poses from images: features, matches, tracks, bundle adjustment, and tests of given poses.

The package uses images and cameras only. It does not depend on projects, stages, or LiDAR scans."""
