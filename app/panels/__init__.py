"""The panels of the window, one per file. Each shows the document and stores no data of its own."""
