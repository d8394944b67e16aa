"""The background during training: its network, its harmonics, and the floor texture. Does not depend on the trainer."""
