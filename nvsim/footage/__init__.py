"""Videos and photographs without camera poses: find them, decode them, choose frames and track points through them.

Knows no project and no camera pose. `nvsim.poses` computes the poses of the frames that are chosen here."""
