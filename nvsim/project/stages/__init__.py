"""The stages of the main job, one module each: its inputs, its computation, and its commit."""
