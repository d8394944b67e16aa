"""Forms derived from the command-line dataclasses. They show the type, default, paper value, unit, and help of every
option, and convert the entered values to arguments of the command."""
