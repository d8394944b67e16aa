"""The state of the window: what is open, how it is read, edited, checked and saved. Knows no view."""
