"""The stages of the main job, one module each: what it reads, what it computes, what it commits."""
