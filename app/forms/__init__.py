"""Forms made from the command line's own dataclasses: every command's options with type, default, the paper's value,
unit and help, and back again into the arguments of the command."""
