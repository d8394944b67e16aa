"""The panels of the window. Each shows the document and stores no data of its own."""
