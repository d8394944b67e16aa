"""The rendering process and the window's end of it: renderer, image size, and timing. Independent of documents."""
