"""Networks that the user brings: where they lie, what a TOML says of their ONNX files, and their way from an image to
values of its pixels. Knows no camera, no floor and no project."""
