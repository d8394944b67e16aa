"""Fast painting of thousands of objects: primitives, graph, picking, colors, legends, cameras. Independent of
documents."""
