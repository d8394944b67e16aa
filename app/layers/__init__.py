"""What can be drawn over the reconstruction, one layer per file. A layer renders from the document and owns nothing of
it; which ones are shown, and how strongly, a user decides in the panel of layers."""
