"""The background while it is learned: its network, its harmonics and the floor texture. Knows no trainer."""
