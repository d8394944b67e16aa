"""The terms of the floor-aware loss and their gradients. Knows no trainer."""
