"""What agents of Room-to-Room see and read: a scan as files, its features, and the simulator over them."""
