"""The command line: arguments become calls of the library, events become progress and tables. It has no numerics."""
