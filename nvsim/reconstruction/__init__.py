"""Convert footage to a capture: frames, camera poses, points, and a report. The package does not depend on projects."""
