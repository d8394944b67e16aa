"""What stands around the viewpoints of an exported scan, as its images show it: things by colour and shape, doorways,
corridors, the floor's colours. Knows no path, and no word of an instruction."""
