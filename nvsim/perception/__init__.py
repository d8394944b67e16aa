"""Floor masks from images: semantic, surface normal, and prompted roles, and the geometric provider that fills all
three. Inference only; this package does not use trained submaps."""
