"""The command line: arguments become calls of the library, its events progress and tables. It computes nothing."""
