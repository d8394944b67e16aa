"""Instructions for paths, made here: what geometry says of a path, in words, and a follower that must find the path
again from what was said. Sends nothing, and asks no network."""
