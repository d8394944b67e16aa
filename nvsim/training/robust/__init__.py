"""Which pixels show transients: the masks that training leaves out. Knows no trainer."""
