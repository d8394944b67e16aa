"""Networks that users install: their folder, the TOML that describes their ONNX files, and the steps from an image to
values of its pixels. This package does not depend on cameras, floors, or projects."""
