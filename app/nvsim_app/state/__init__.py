"""The state of the window: the open document, and how it is read, edited, checked, and saved. Independent of views."""
