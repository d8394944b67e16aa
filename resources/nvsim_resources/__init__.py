"""Icons, shaders, help texts and documentation that travel with the wheel."""
